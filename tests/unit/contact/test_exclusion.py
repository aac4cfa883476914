"""Exclusion of cells that cannot penetrate."""

import numpy as np
import pytest

from app import Grid, Material
from app.contact.exclusion import BlockBounds
from app.halfspace.influence import influence_quadrant
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.operator import InfluenceOperator

KERNEL = Material.from_contact_modulus(1.0).kernel
MATERIALS = {
    "half-space": Material.from_contact_modulus(1.0),
    "layer": Material.layer(young=1.0, poisson=0.45, thickness=2.0),  # some coefficients are negative
}


BODIES = {
    "half-spaces": KERNEL,
    "layer": Material.layer(1.0, 0.45, 0.7).kernel,
    "incompressible layer": Material.layer(1.0, 0.5, 3.0, other=(20.0, 0.3)).kernel,
    "stiff coating": Material.coated((80.0, 1.0), (0.3, 0.3), 0.4).kernel,
    "soft coating": Material.coated((0.01, 1.0), (0.5, 0.3), 1.5).kernel,
}


@pytest.mark.parametrize("kernel", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("shape", [(100, 70), (33, 128), (16, 16), (47, 5)])
def test_no_excluded_cell_penetrates(shape, kernel):
    rng, grid = np.random.default_rng(3), Grid(shape[1], shape[0], 0.3, 0.2)
    operator, u = InfluenceOperator(grid, kernel), np.empty(shape)
    for _ in range(10):
        cells = np.sort(rng.choice(grid.n, rng.integers(1, 1 + grid.n // 20), replace=False))
        p, whole = rng.random(cells.size), np.zeros(shape)
        whole.flat[cells] = p
        operator.exact_displacement(whole, u)
        b = u + rng.uniform(-1.0, 0.5, shape) * abs(u)  # a cell penetrates where b exceeds u
        admissible = rng.random(shape) < 0.9
        undecided = BlockBounds(grid, kernel, b, admissible).undecided(cells, p, 0.0)
        assert np.isin(np.flatnonzero(admissible & (b > u)), undecided).all()
        assert admissible.flat[undecided].all()


@pytest.mark.parametrize("kernel", BODIES.values(), ids=BODIES)
def test_bounds_of_far_blocks_are_sharp(kernel):
    near = np.array([40.0, 160.0])
    low, r = kernel.least_influence(near, 1.1 * near), np.linspace(near, 1.1 * near, 1001)
    least = kernel.point_influence(r).min(axis=0)
    assert (low <= least + 1e-12 * kernel.compliance).all()
    # Of 1 / r, too: it cancels on a rigid base.
    assert (low >= least - 0.05 * (least + 0.01 * kernel.compliance / near)).all()


def test_holes_do_not_raise_the_maximum_of_a_block():
    b, admissible = np.full((40, 40), -1.0), np.ones((40, 40), bool)
    b[3, 4], admissible[3, 4] = 0.0, False
    undecided = BlockBounds(Grid(40, 40, 1.0, 1.0), KERNEL, b, admissible).undecided(
        np.array([500]), np.ones(1), 0.5
    )
    assert not undecided.size


@pytest.mark.parametrize("periodic", ["spectral", "love", "x", "y"])
@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
@pytest.mark.parametrize("shape", [(96, 64), (48, 80)])  # even and odd numbers of blocks
def test_no_excluded_cell_of_a_periodic_patch_penetrates(shape, material, periodic):
    rng, grid = np.random.default_rng(3), Grid(shape[1], shape[0], 0.3, 0.2, periodic=periodic)
    kernel, u = patch_kernel(material.kernel, grid), np.empty(shape)
    operator = InfluenceOperator(grid, kernel)
    rows, columns = (n // 2 + 1 if whole else n for n, whole in zip(shape, grid.repeats, strict=True))
    quadrant = influence_quadrant(grid, kernel, slice(0, rows), columns)
    for _ in range(10):
        cells = np.sort(rng.choice(grid.n, rng.integers(1, 1 + grid.n // 20), replace=False))
        p, whole = rng.random(cells.size), np.zeros(shape)
        whole.flat[cells] = p
        operator.exact_displacement(whole, u)
        b = u + np.abs(u).max() * rng.uniform(-1.0, 0.1, shape)
        undecided = BlockBounds(grid, kernel, b, np.ones(shape, bool), quadrant=quadrant).undecided(
            cells, p, 0.0
        )
        assert np.isin(np.flatnonzero(b > u), undecided).all()


def test_far_cells_are_excluded_and_slabs_give_the_same_cells():
    rng, grid = np.random.default_rng(4), Grid(90, 61, 0.1, 0.1)
    cells, p, b = np.array([1234, 3000]), np.array([1.0, 2.0]), -rng.random(grid.shape)
    b.flat[[1234, 3000]] = 0.5
    every = np.ones(b.shape, bool)
    blocks = BlockBounds(grid, KERNEL, b, every)
    undecided = blocks.undecided(cells, p, 0.1)
    assert 2 <= undecided.size < 0.2 * grid.n
    u, first = blocks.displacement(cells, p), 23
    np.testing.assert_array_equal(
        BlockBounds(grid, KERNEL, b[first:], every[first:], first).displacement(cells, p), u
    )
    parts = (
        BlockBounds(grid, KERNEL, b[:first], every[:first]),
        BlockBounds(grid, KERNEL, b[first:], every[first:], first),
    )
    joined = np.concatenate([part.undecided(cells, p, 0.1) for part in parts])
    np.testing.assert_array_equal(joined, undecided)


def test_without_pressure_all_overlapping_cells_are_undecided():
    b = np.random.default_rng(5).random((20, 30)) - 0.5
    none = np.zeros(0, int), np.zeros(0)
    undecided = BlockBounds(Grid(30, 20, 1.0, 1.0), KERNEL, b, np.ones(b.shape, bool)).undecided(*none, 0.2)
    np.testing.assert_array_equal(undecided, np.flatnonzero(b + 0.2 > 0))
