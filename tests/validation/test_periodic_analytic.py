"""Periodic contact against analytic solutions: Westergaard, full contact, and both ends of two waves."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.problems.surfaces import SelfAffineSurface
from app.reference import Bisinusoidal, Westergaard, full_contact_pressure

E_STAR, AMPLITUDE, LENGTH = 900.0, 0.02, 1.7


each_method = pytest.mark.parametrize("method", [None, "norm"], ids=["default", "NORM"])


def pressed(problem, method=None, **loading):
    with ContactSolver(problem, method) as solver:
        solution = solver.solve(**loading)
    assert solution.converged, solution.message
    return solution


def waves(contact, nx, ny, symbol="spectral"):
    """The problem of a wavy surface on one period (of any length along the crests), and its grid."""
    grid = Grid.from_domain(nx, ny, (0.0, LENGTH, 0.0, LENGTH * ny / nx if ny < nx else LENGTH))
    return ContactProblem(grid, Material(E_STAR, 0.0), contact.undeformed_distance, periodic=symbol), grid


def order(sizes, errors):
    return -np.polyfit(np.log2(sizes), np.log2(errors), 1)[0]


@each_method
@pytest.mark.parametrize("symbol", ["spectral", "love"])
def test_westergaard_with_the_expected_order(symbol, method):
    # The contact set is right but for a cell at every rim; where the pressure is smooth it is of second order.
    c = Westergaard(AMPLITUDE, LENGTH, E_STAR, 0.3 * np.pi * E_STAR * AMPLITUDE / LENGTH)
    sizes = 32, 48, 64, 96, 128
    at_summits, rms, loads = [], [], []
    for n in sizes:
        problem, grid = waves(c, n, 4, symbol)
        solution = pressed(problem, method, approach=c.approach)
        exact = c.pressure(grid.x(), 0.0)
        assert (np.ptp(solution.pressure, axis=0) <= 1e-5 * c.max_pressure).all()
        assert abs(solution.contact[0].sum() - c.contact_fraction * n) < 2
        rms.append(np.sqrt(np.mean((solution.pressure - exact) ** 2)) / c.max_pressure)
        at_summits.append(abs(solution.pressure.max() / c.max_pressure - 1))
        loads.append(abs(solution.pressure.mean() / c.mean_pressure - 1))
        assert np.mean(solution.gap) == pytest.approx(c.mean_gap, rel=1e-5)
    assert order(sizes, at_summits) == pytest.approx(2, abs=0.3)
    assert order(sizes, rms) > 1
    assert order(sizes, loads) > 1.5
    assert max(at_summits[-1], loads[-1]) < 5e-4


def test_westergaard_by_mean_pressure():
    c = Westergaard(AMPLITUDE, LENGTH, E_STAR, 0.3 * np.pi * E_STAR * AMPLITUDE / LENGTH)
    problem, _ = waves(c, 128, 4)
    solution = pressed(problem, mean_pressure=c.mean_pressure)
    assert solution.pressure.mean() == pytest.approx(c.mean_pressure, rel=1e-6)
    assert solution.mean_pressure == pytest.approx(c.mean_pressure, rel=1e-6)
    assert solution.mean_gap == pytest.approx(c.mean_gap, rel=2e-3)
    assert solution.approach == pytest.approx(c.approach, rel=1e-3)
    other = pressed(problem, mean_gap=solution.mean_gap)
    np.testing.assert_allclose(other.pressure, solution.pressure, atol=1e-4 * c.max_pressure)


@pytest.mark.parametrize("shape", [(32, 48), (40, 40)])
def test_full_contact_of_any_surface(shape):
    grid = Grid.from_domain(shape[1], shape[0], (0.0, 1.5, 0.0, 0.8))
    surface = SelfAffineSurface(0.8, 0.4, 0.1, (1.5, 0.8), 5, rms_slope=0.1)
    distance = -surface.height(grid.x(), grid.y())
    problem = ContactProblem(grid, Material(E_STAR, 0.0), distance, periodic=True)
    tension = -full_contact_pressure(distance, grid.dx, grid.dy, E_STAR).min()
    mean_pressure = 1.01 * tension
    solution = pressed(problem, mean_pressure=mean_pressure)
    exact = full_contact_pressure(distance, grid.dx, grid.dy, E_STAR, mean_pressure)
    assert solution.contact.all()
    np.testing.assert_allclose(solution.pressure, exact, atol=1e-12 * exact.max())
    np.testing.assert_allclose(solution.gap, 0, atol=1e-12 * np.ptp(distance))
    assert not pressed(problem, mean_pressure=0.97 * tension).contact.all()


def test_lightly_loaded_waves_bear_like_hertz_on_every_summit():
    for share in (0.003, 0.005):
        c = Bisinusoidal(AMPLITUDE, LENGTH, E_STAR, share * np.sqrt(2) * np.pi * E_STAR * AMPLITUDE / LENGTH)
        problem, _ = waves(c, 128, 128)
        solution = pressed(problem, mean_pressure=c.mean_pressure)
        assert solution.pressure.max() == pytest.approx(c.on_a_summit.max_pressure, rel=0.02)
        assert solution.contact_fraction_corrected == pytest.approx(c.light_contact_fraction, rel=0.04)


def test_nearly_full_contact_of_waves_leaves_cracks_about_the_hollows():
    for share, error in ((0.9, 0.05), (0.95, 0.025)):
        c = Bisinusoidal(AMPLITUDE, LENGTH, E_STAR, share * np.sqrt(2) * np.pi * E_STAR * AMPLITUDE / LENGTH)
        problem, _ = waves(c, 128, 128)
        solution = pressed(problem, mean_pressure=c.mean_pressure)
        assert solution.contact.mean() == pytest.approx(c.heavy_contact_fraction, abs=2e-3)
        assert np.mean(solution.gap) == pytest.approx(c.heavy_mean_gap, rel=error)
