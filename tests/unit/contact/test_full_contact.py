"""Full contact of periodic patches."""

import numpy as np
import periodic
import pytest
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact import full_contact

each_method = pytest.mark.parametrize("method", [None, "norm", "fmg_v11"], ids=["default", "NORM", "FMG"])


@pytest.mark.parametrize("symbol", ["spectral", "love"])
@each_method
def test_full_contact_is_found_in_two_products(method, symbol):
    problem = periodic.rough(20, 15, 8, symbol=symbol)
    with ContactSolver(problem, method) as solver:
        least = solver.solve(approach=problem.gap.mean())
        assert least.pressure.min() == 0
        found = solver.solve(load=2 * least.load)
    for solution in (least, found):
        assert solution.converged and solution.contact.all()
        assert solution.iterations == len(solution.history["level"]) == 1
        assert solution.operator_applications <= 2
        assert abs(solution.gap).max() <= 1e-12 * np.ptp(problem.gap)
        assert solution.approach == pytest.approx(problem.gap.mean(), rel=1e-14)
        assert solution.error_bound < 1e-6
    lifted = found.pressure - found.pressure.mean() + least.pressure.mean()
    np.testing.assert_allclose(lifted, least.pressure, rtol=0, atol=1e-12 * least.max_pressure)
    if symbol == "spectral":  # p_q = E* |q| h_q / 2
        grid = problem.grid
        qx, qy = (2 * np.pi * np.fft.fftfreq(n, d) for n, d in ((grid.nx, grid.dx), (grid.ny, grid.dy)))
        modulus = problem.material.contact_modulus
        p = np.fft.ifft2(-modulus / 2 * np.hypot(qx, qy[:, None]) * np.fft.fft2(problem.gap)).real
        np.testing.assert_allclose(
            found.pressure - found.pressure.mean(), p, rtol=0, atol=1e-12 * abs(p).max()
        )


@pytest.mark.parametrize("share", [0.05, 2.0])
def test_full_contact_is_postponed_if_a_coarser_grid_is_far_from_it(monkeypatch, share):
    """This saves a product; the solution is the same."""
    problem = periodic.rough(64, 64, 8)
    with ContactSolver(problem) as solver:
        load = share * solver.solve(approach=problem.gap.mean()).load
    counts, found = [], []
    for far in (0.0, full_contact._MAX_PRESSURE_FRACTION, np.inf):
        monkeypatch.setattr(full_contact, "_MAX_PRESSURE_FRACTION", far)
        found.append(solve(problem, None, None, load))
        counts.append(found[-1].operator_applications)
    for other in found[1:]:
        assert other.contact.all() == (share > 1)
        atol = 1e-4 * found[0].max_pressure
        np.testing.assert_allclose(other.pressure, found[0].pressure, rtol=0, atol=atol)
    if share > 1:
        assert counts[:2] == [2 + 1 / 16] * 2
    else:
        assert counts == pytest.approx([counts[1] + 1, counts[1], counts[1]], rel=1e-9)


def ridge_between_cells(x, y):
    """A ridge that only coarse grids sample."""
    return 1e-3 * np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y) - 5e-3 * np.exp(-(((x - 0.5) / 0.003) ** 2))


def hole_on_coarse_grids(x, y):
    hole = (x - 2 / 64) ** 2 + (y - 2 / 64) ** 2 < 0.005**2
    return np.where(hole, np.nan, 1e-3 * np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y) + 0.01)


@pytest.mark.parametrize(
    ("n", "gap", "pressure"),
    [
        (250, np.full((250, 250), 7.7), 1e-8),  # means are of rounding
        (100, ridge_between_cells, 0.03),
        (64, hole_on_coarse_grids, 0.01),
    ],
    ids=["flat", "ridge", "hole"],
)
@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_full_contact_is_found_where_a_coarser_grid_is_wrong(n, gap, pressure, rtol):
    problem = ContactProblem(Grid(n, n, 1 / n, 1 / n), Material.from_contact_modulus(1.0), gap, periodic=True)
    with ContactSolver(problem, options={"lcp_rtol": rtol}) as solver:
        for _ in range(2):
            found = solver.solve(mean_pressure=pressure)
            assert found.converged and found.contact.all() and found.error_bound < 1e-7
    assert found.operator_applications == 2  # known now
