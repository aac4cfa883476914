"""Lists of cells on two grids."""

import numpy as np
import pytest

from app import Grid, Material
from app.halfspace.operator import InfluenceOperator
from app.methods.free import dilute
from app.multigrid.transfer import Transfer

KERNEL = Material.from_contact_modulus(1.0).kernel


@pytest.mark.parametrize(("nx", "ny"), [(12, 10), (13, 11), (9, 14)])
def test_lists_are_refined_and_restricted_like_fields(nx, ny):
    rng, grid = np.random.default_rng(1), Grid(nx, ny, 1.0, 1.0)
    coarse = grid.coarsen(1)
    transfer = Transfer(InfluenceOperator(grid, KERNEL), InfluenceOperator(coarse, KERNEL), (2, 2))
    p = np.where(rng.random(coarse.shape) < 0.1, rng.random(coarse.shape), 0.0)
    fine, cells = np.empty(grid.shape), np.flatnonzero(p)
    transfer.copy(p, fine)
    listed, pressures = dilute._refine(cells, p.flat[cells], grid)
    whole = np.zeros(grid.shape)
    whole.flat[listed] = pressures
    np.testing.assert_array_equal(whole, fine)
    assert np.isin(dilute._widen(np.flatnonzero(fine), grid), listed).all()
    changed = pressures * rng.random(listed.size)
    whole.flat[listed] = changed
    means, before = dilute._restrict(listed, changed, (cells, p.flat[cells]), grid)
    expected = transfer.restrict_defect(whole)
    assert np.linalg.norm(means - before) == pytest.approx(np.linalg.norm(expected - p))
    assert means.sum() == pytest.approx(expected.sum())


@pytest.mark.parametrize("periodic", ["x", "y", "spectral"])
def test_neighbours_are_found_across_the_sides(periodic):
    grid = Grid(32, 16, 1.0, 1.0, periodic=periodic)
    wide = dilute._widen(np.array([0]), grid)
    columns = (31, 0, 1) if periodic != "y" else (0, 1)
    rows = (15, 0, 1) if periodic != "x" else (0, 1)
    np.testing.assert_array_equal(wide, sorted(32 * j + i for j in rows for i in columns))
