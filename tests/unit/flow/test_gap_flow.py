"""Flow through a gap, against exact solutions and dense solves."""

import numpy as np
import pytest
from petsc4py import PETSc

from app import Grid, InputError
from app.flow import gap_flow
from app.flow.gap_flow import MAX_ERROR, PREFIX, set_options, solve_flow
from app.options.solver_options import temporary_options

PATCHES = pytest.mark.parametrize("periodic", [False, "x", "y", True])


def random_gap(grid, seed, closed=0.3, decades=2):
    """Return gaps over many decades, and a random set of open cells."""
    rng = np.random.default_rng(seed)
    return 10 ** -(decades * rng.random(grid.shape)), rng.random(grid.shape) > closed


def solve_dense(gap, is_open, grid, along):
    """Return the transmissivity by a dense solve, from a loop over faces."""
    repeats = dict(zip("yx", grid.repeats, strict=True))
    cubes, number = np.where(is_open, gap, 0.0) ** 3, np.arange(grid.n).reshape(grid.shape)
    matrix, b, constant = np.zeros((grid.n, grid.n)), np.zeros(grid.n), 0.0

    def add(one, other, conductance, jump):
        """Add the energy k (P_one - P_other + jump)^2; `other` may be None."""
        nonlocal constant
        sign = np.zeros(grid.n)
        sign[one] += 1
        if other is not None:
            sign[other] -= 1
        matrix[...] += conductance * np.outer(sign, sign)
        b[...] -= conductance * jump * sign
        constant += conductance * jump**2

    for j in range(grid.ny):
        for i in range(grid.nx):
            for axis, (end, other, k) in {
                "x": (i == grid.nx - 1, (j, (i + 1) % grid.nx), grid.dy / grid.dx),
                "y": (j == grid.ny - 1, ((j + 1) % grid.ny, i), grid.dx / grid.dy),
            }.items():
                one, two = cubes[j, i], cubes[other]
                if not end or repeats[axis]:
                    if one and two:
                        jump = float(end and axis == along)
                        add(number[j, i], number[other], k * 2 * one * two / (one + two), jump)
                elif axis == along:
                    add(number[j, i], None, 2 * k * one, 0.0)
                    add(number[other], None, 2 * k * two, -1.0)
    p = np.linalg.lstsq(matrix, b, rcond=1e-13)[0]
    length, width = grid.sides if along == "x" else grid.sides[::-1]
    return (p @ matrix @ p - 2 * b @ p + constant) * length / (12 * width)


@PATCHES
def test_uniform_gap_is_exact(periodic):
    grid = Grid.from_domain(12, 7, (0, 3, 1, 2), periodic)
    flow = solve_flow(np.full(grid.shape, 0.5), np.ones(grid.shape, bool), grid)
    assert flow.percolates_x is flow.percolates_y is True
    assert flow.flow_error < 1e-12
    for along in "xy":
        assert getattr(flow, f"hydraulic_aperture_{along}") == pytest.approx(0.5, rel=1e-13)
        assert getattr(flow, f"transmissivity_{along}") == pytest.approx(0.5**3 / 12, rel=1e-13)
    assert np.allclose(flow.fluid_pressure, 1 - (grid.x() - 0) / 3, atol=1e-12)
    assert np.allclose(flow.flux_x, 0.5**3 / 12 / 3) and np.allclose(flow.flux_y, 0)
    assert np.allclose(flow.y.flux_y, 0.5**3 / 12) and np.allclose(flow.y.flux_x, 0)


@PATCHES
def test_strips_in_series_and_in_parallel_are_exact(periodic):
    grid = Grid.from_domain(8, 6, (0, 1, 0, 2), periodic)
    strips = np.array([1e-4, 0.3, 1.0, 2.0, 0.1, 0.7, 5.0, 0.2])
    flow = solve_flow(np.broadcast_to(strips, grid.shape), np.ones(grid.shape, bool), grid)
    series, parallel = 1 / np.mean(strips**-3), np.mean(strips**3)
    assert flow.transmissivity_x == pytest.approx(series / 12, rel=2 * MAX_ERROR)
    assert flow.lower_x <= series / 12 <= flow.upper_x
    assert flow.transmissivity_y == pytest.approx(parallel / 12, rel=1e-12)


@PATCHES
@pytest.mark.parametrize("seed", range(6))
def test_bounds_enclose_the_dense_solution(periodic, seed):
    grid = Grid.from_domain(9, 8, (0, 2, 0, 1), periodic)
    gap, is_open = random_gap(grid, seed, closed=0.35 * seed / 5)
    for options in ({}, {"ksp_rtol": "0.3"}, {"ksp_max_it": "1", "pc_type": "jacobi"}, {"pc_type": "none"}):
        with temporary_options(PREFIX, {}, options):
            flow = solve_flow(gap, is_open, grid)
        for along in "xy":
            exact, one = solve_dense(gap, is_open, grid, along), getattr(flow, along)
            assert one.lower <= exact * (1 + 1e-9) and exact * (1 - 1e-9) <= one.upper
            assert one.percolates == (exact > 1e-12)
            assert one.percolates == (one.upper > 0)
        assert options or flow.flow_error <= MAX_ERROR


@PATCHES
def test_fluxes_conserve_fluid_and_carry_the_flow(periodic):
    grid = Grid.from_domain(20, 16, (0, 1, 0, 1), periodic)
    gap, is_open = random_gap(grid, 4, closed=0.2)
    for options in ({}, {"ksp_rtol": "0.3"}):
        with temporary_options(PREFIX, {}, options):
            flow = solve_flow(gap, is_open, grid)
        # The mean of the fluxes through both faces of a cell, times its width, over the columns.
        rates = flow.flux_x.sum(axis=0) * grid.dy
        assert np.ptp(rates) < 1e-12 * rates.mean()
        assert rates.mean() == pytest.approx(flow.transmissivity_x, rel=2 * flow.flow_error + 1e-12)


def test_flow_past_a_disc_converges():
    """In a uniform gap, a row of discs of area fraction f leaves about (1 - f) / (1 + f) of the flow.

    Rayleigh (1892): (1 - f - c) / (1 + f - c), with c = 0.30583 f^4 + ..., for a square array of discs that do not
    conduct.
    """
    errors = []
    for n in (32, 64, 128):
        grid = Grid.from_domain(n, n, (-1, 1, -1, 1), True)
        is_open = np.hypot(grid.x(), grid.y()[:, None]) > 0.8
        fraction = 0.64 * np.pi / 4
        c = 0.305827 * fraction**4 / (1 - 1.402958 * fraction**8) + 0.013362 * fraction**8
        exact = (1 - fraction - c) / (1 + fraction - c)
        flow = solve_flow(np.ones(grid.shape), is_open, grid)
        assert flow.transmissivity_x == pytest.approx(flow.transmissivity_y, rel=2 * MAX_ERROR)
        errors.append(abs(12 * flow.transmissivity_x / exact - 1))
    assert errors[-1] < 0.02 and errors[-1] < errors[0] / 2


@PATCHES
def test_closed_gap_needs_no_solve(periodic, monkeypatch):
    grid = Grid.from_domain(10, 8, (0, 1, 0, 1), periodic)
    is_open = np.ones(grid.shape, bool)
    is_open[:, 6] = is_open[3] = False
    monkeypatch.setattr(gap_flow._PressureSolver, "solve", None)
    flow = solve_flow(np.ones(grid.shape), is_open, grid)
    assert flow.percolates_x is flow.percolates_y is False
    assert flow.transmissivity_x == flow.upper_y == flow.lower_x == flow.flow_error == 0
    assert not flow.flux_x.any() and np.isnan(flow.fluid_pressure).all()


def test_cells_without_a_gap_are_closed():
    grid = Grid.from_domain(4, 4, (0, 1, 0, 1))
    gap, everywhere = np.ones(grid.shape), np.ones(grid.shape, bool)
    for value in (np.nan, 0.0, -1e-9):
        gap[:, 2] = value
        assert not solve_flow(gap, everywhere, grid).percolates_x
    assert not solve_flow(np.zeros(grid.shape), everywhere, grid).percolates_x


@pytest.mark.parametrize("narrow", [1e-5, 1e-9, 1e-60])
def test_bounds_hold_for_narrow_passages(narrow):
    """All fluid flows through one cell, in a patch whose other cells are wide."""
    grid = Grid.from_domain(21, 21, (0, 1, 0, 1))
    gap, is_open = np.ones(grid.shape), np.ones(grid.shape, bool)
    is_open[:, 10], is_open[7, 10], gap[7, 10] = False, True, narrow
    flow = solve_flow(gap, is_open, grid)
    assert flow.lower_x * (1 - 1e-9) <= narrow**3 / 12 * 1.0000001 and narrow**3 / 12 <= flow.upper_x * 1.001
    assert narrow < 1e-8 or flow.flow_error < MAX_ERROR


def test_bounds_are_close_if_one_direction_is_almost_closed():
    """Both directions have the same matrix, but very different flow rates."""
    grid = Grid.from_domain(30, 24, (0, 1, 0, 1), True)
    gap, is_open = random_gap(grid, 7, closed=0.1, decades=1)
    is_open[:, 15], gap[9, 15], is_open[9, 15] = False, 1e-4, True
    flow = solve_flow(gap, is_open, grid)
    assert flow.flow_error < MAX_ERROR and flow.transmissivity_x < 1e-8 * flow.transmissivity_y


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2), (3, 2), (2, 3)])
@PATCHES
def test_patches_of_few_cells(periodic, shape):
    grid = Grid.from_domain(*shape[::-1], (0, 1, 0, 1), periodic)
    gap, is_open = random_gap(grid, 1, closed=0.0)
    flow = solve_flow(gap, is_open, grid)
    for along in "xy":
        exact = solve_dense(gap, is_open, grid, along)
        assert getattr(flow, along).lower <= exact * (1 + 1e-9)
        assert exact * (1 - 1e-9) <= getattr(flow, along).upper


def test_flow_does_not_depend_on_where_a_period_begins():
    grid = Grid.from_domain(24, 20, (0, 1, 0, 1), True)
    gap, is_open = random_gap(grid, 2)
    one = solve_flow(gap, is_open, grid)
    other = solve_flow(*(np.roll(field, (7, 5), axis=(0, 1)) for field in (gap, is_open)), grid)
    assert other.transmissivity_x == pytest.approx(one.transmissivity_x, rel=3 * MAX_ERROR)
    assert other.transmissivity_y == pytest.approx(one.transmissivity_y, rel=3 * MAX_ERROR)


def test_options_of_petsc_are_used_or_refused():
    grid = Grid.from_domain(16, 16, (0, 1, 0, 1))
    gap, is_open = random_gap(grid, 3)
    default = solve_flow(gap, is_open, grid)
    assert default.flow_error <= MAX_ERROR
    try:
        set_options({"flow_ksp_rtol": "0.5", "flow_ksp_view": ":/dev/null"})
        assert solve_flow(gap, is_open, grid).flow_error > default.flow_error
    finally:
        for name in ("flow_ksp_rtol", "flow_ksp_view"):
            PETSc.Options().delValue(name)
    wrong = {
        "flow_ksp_bogus": "1",
        "flow_pc_type": "nonsense",
        "flow_ksp_rtol": "nonsense",
        "flow_ksp_max_it": "nonsense",
    }
    for name, text in (*wrong.items(), ("flow_ksp_rtol", "-1"), ("flow_ksp_rtol", "nan")):
        with pytest.raises(InputError, match=f"{name}|nonsense"):
            set_options({name: text})
        assert not PETSc.Options().hasName(name)
    with temporary_options(PREFIX, {}, {"pc_type": "gamg"}):
        assert solve_flow(gap, is_open, grid).flow_error <= MAX_ERROR
