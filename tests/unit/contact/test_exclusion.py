"""Exclusion of cells that cannot penetrate."""

import numpy as np
import pytest

from app import Grid, Material
from app.contact.exclusion import BlockBounds
from app.halfspace.operator import InfluenceOperator

KERNEL = Material.from_contact_modulus(1.0).kernel


@pytest.mark.parametrize("shape", [(100, 70), (33, 128), (16, 16), (47, 5)])
def test_no_excluded_cell_penetrates(shape):
    rng, grid = np.random.default_rng(3), Grid(shape[1], shape[0], 0.3, 0.2)
    operator, u = InfluenceOperator(grid, KERNEL), np.empty(shape)
    for _ in range(10):
        cells = np.sort(rng.choice(grid.n, rng.integers(1, 1 + grid.n // 20), replace=False))
        p, whole = rng.random(cells.size), np.zeros(shape)
        whole.flat[cells] = p
        operator.exact_displacement(whole, u)
        b = u * rng.uniform(0.5, 1.2, shape)  # a cell penetrates where b exceeds u
        undecided = BlockBounds(grid, KERNEL, b).undecided(cells, p, 0.0)
        assert np.isin(np.flatnonzero(b > u), undecided).all()


def test_far_cells_are_excluded_and_slabs_give_the_same_cells():
    rng, grid = np.random.default_rng(4), Grid(90, 61, 0.1, 0.1)
    cells, p, b = np.array([1234, 3000]), np.array([1.0, 2.0]), -rng.random(grid.shape)
    b.flat[[1234, 3000]] = 0.5
    blocks = BlockBounds(grid, KERNEL, b)
    undecided = blocks.undecided(cells, p, 0.1)
    assert 2 <= undecided.size < 0.2 * grid.n
    u, first = blocks.displacement(cells, p), 23
    np.testing.assert_array_equal(BlockBounds(grid, KERNEL, b[first:], first).displacement(cells, p), u)
    parts = BlockBounds(grid, KERNEL, b[:first]), BlockBounds(grid, KERNEL, b[first:], first)
    joined = np.concatenate([part.undecided(cells, p, 0.1) for part in parts])
    np.testing.assert_array_equal(joined, undecided)


def test_without_pressure_all_overlapping_cells_are_undecided():
    b = np.random.default_rng(5).random((20, 30)) - 0.5
    none = np.zeros(0, int), np.zeros(0)
    undecided = BlockBounds(Grid(30, 20, 1.0, 1.0), KERNEL, b).undecided(*none, 0.2)
    np.testing.assert_array_equal(undecided, np.flatnonzero(b + 0.2 > 0))
