"""Preconditioner of the primal form."""

import numpy as np
import pytest
from operators import random_field

from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.methods.periodic.two_grid import TwoGrid

SINGLE = 2e-6


def patch(nx, ny, stretch=1.0, symbol="spectral"):
    return Grid(nx, ny, 1.0 / nx, stretch / nx, periodic=symbol)


GRIDS = {
    "square": patch(32, 32),
    "stretched": patch(32, 24, 3.0, "love"),
    "odd": patch(21, 15),
    "one row": patch(64, 1),
    "two columns": patch(2, 64),
    "long cells": patch(24, 20, 20.0),
    "flat cells": patch(24, 20, 0.05),
    "two rows of flat cells": patch(64, 2, 0.05),
}


each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())


def applied(solver, field):
    assert isinstance(solver.preconditioner, TwoGrid)
    z = np.empty(field.shape)
    solver.preconditioner.smooth(field, z)
    return z


def matrices(solver):
    """M and B on the free cells."""
    grid, free = solver.operator.grid, solver.inverse.mask
    units = np.eye(grid.n).reshape(-1, *grid.shape)[free.reshape(-1)]
    m, b = np.empty((2, len(units), len(units)))
    pressure = np.empty(grid.shape)
    for unit, of_m, of_b in zip(units, m, b, strict=True):
        of_m[...] = applied(solver, unit)[free]
        solver.inverse.exact_pressure(unit, pressure)
        of_b[...] = pressure[free]
    return m, b


@each_grid
@pytest.mark.parametrize("share", [0.0, 0.03, 0.3, 0.5, 0.97])
def test_preconditioner_is_positive_with_eigenvalues_near_one(make, grid, share):
    solver = make(grid, share)
    free = solver.inverse.mask
    assert (applied(solver, random_field(grid, 5))[~free] == 0).all()
    m, b = matrices(solver)
    assert np.linalg.eigvalsh(m + m.T).min() > 0
    values = np.linalg.eigvals(b @ m)
    values = values[abs(values) > 1e-9]  # B does not see the constant
    assert len(values) >= len(m) - (share == 0)
    long = max(grid.dx / grid.dy, grid.dy / grid.dx) > 4  # the coarser grid does not have all waves
    assert (
        values.real.min() > (0.08 if long else 0.35)
        and values.real.max() < 2
        and abs(values.imag).max() < 0.25
    )
    free.flat[np.flatnonzero(free)[::2]] = False  # another contact set
    solver.set_contact()
    assert (applied(solver, random_field(grid, 6))[~free] == 0).all()


@pytest.mark.parametrize("grid", [patch(24, 20), patch(20, 12, 3.0, "love")], ids=str)
@pytest.mark.parametrize(
    "young, nu", [((1.0, np.inf), 0.3), ((1.0, np.inf), 0.45), ((1.0, 20.0), 0.1), ((5.0, 1.0), 0.3)]
)
@pytest.mark.parametrize("cells", [0.3, 1.0, 4.0])
def test_preconditioner_of_layers_is_positive(make, grid, young, nu, cells):
    """On thin layers, also for long waves."""
    kernel = Material.coated(young, (nu, 0.3), cells * grid.dx).kernel
    for share in (0.03, 0.5):
        m, b = matrices(make(grid, share, kernel=kernel))
        assert np.linalg.eigvalsh(m + m.T).min() > 0
        first, second, last = np.sort(np.linalg.eigvals(b @ m).real)[
            [0, 1, -2]
        ]  # one eigenvalue at each end is of a nearly constant field
        assert first > 0
        assert second > 0.2
        assert last < 2


@each_grid
def test_constrained_preconditioner_keeps_the_mean_and_shift_moves_it(make, grid):
    solver = make(grid)
    pc, free, r = solver.preconditioner, solver.inverse.mask, random_field(grid, 6)
    loose = applied(solver, r * free)
    pc.constrained = True
    kept = applied(solver, r * free)
    assert abs(kept.mean()) <= 1e-12 * abs(kept).max()
    assert (kept[~free] == 0).all()
    # Of a constant pressure nothing is left: all of it is the multiplier.
    one = applied(solver, np.ones(grid.shape))
    assert abs(one).max() <= 1e-5 * abs(loose).max()
    assert pc.multiplier == pytest.approx(1.0, rel=1e-6)
    w = r.copy()
    pc.shift(0.7, w)
    assert w.sum() - r.sum() == pytest.approx(0.7, rel=1e-12)
    assert (w[~free] == r[~free]).all() and (w[free] >= r[free]).all()
    free[...] = False
    solver.set_contact()
    before = w.copy()
    pc.shift(0.7, w)  # nothing is there to be raised
    np.testing.assert_array_equal(w, before)
    np.testing.assert_array_equal(applied(solver, r), 0)


@pytest.mark.parametrize("share", [0.003, 0.03])
@pytest.mark.parametrize("n", [64, 128, 256])
def test_compliance_of_a_constant_is_that_of_scattered_contact(make, n, share):
    solver = make(patch(n, n), share)
    ones = np.ones((n, n))
    raised = applied(solver, ones).astype(np.float32)
    pressure = np.empty_like(raised)
    solver.inverse.pressure(raised, pressure)
    assert 0.6 < np.vdot(raised, pressure) / raised.sum() < 1.4


def test_preconditioner_is_translation_invariant(make):
    grid, shift = patch(32, 24), (4, 8)  # whole cells of the grid of long waves
    solver, r = make(grid), random_field(grid, 7)
    free = solver.inverse.mask
    here = applied(solver, r)
    free[...] = np.roll(free, shift, (0, 1))
    solver.set_contact()
    there = applied(solver, np.roll(r, shift, (0, 1)))
    np.testing.assert_allclose(there, np.roll(here, shift, (0, 1)), rtol=0, atol=SINGLE * abs(here).max())


@pytest.mark.parametrize("nx, ny", [(1, 1), (1, 2), (2, 1), (1, 9), (9, 1), (2, 9), (9, 2)])
@pytest.mark.parametrize("symbol", ["spectral", "love"])
def test_weights_of_few_cells_are_finite_for_layers(make, nx, ny, symbol):
    """One cell in a direction is its own neighbour."""
    for young in ((1.0, np.inf), (1.0, 20.0), (5.0, 1.0)):
        kernel = Material.coated(young, (0.3, 0.3), 0.2).kernel
        solver = make(patch(nx, ny, symbol=symbol), 0.5, kernel=kernel)
        assert np.isfinite(applied(solver, random_field(solver.inverse.mask, 5))).all()
