"""Searched loadings: a prescribed maximum pressure."""

import pytest
from recorded import ball

from app import ContactSolver, InputError, Material, solve
from app.contact.approach_search import SearchedLoading
from app.contact.loading_input import LOADINGS


class PrescribedMaxPressure(SearchedLoading):
    """Prescribed maximum pressure."""

    name = kind = "max_pressure"
    unit, meaning, exact = "N/mm2", "maximum pressure", ("max_pressure",)
    result_rtol = 1e-3

    @classmethod
    def create(cls, value, grid, distance, uniform_compliance=0.0):
        return cls(value)

    def measure(self, state):
        return -float(state.minimum([-state.p.max(initial=0.0)])[0])

    def resolution(self, grid):
        return 1e-4


@pytest.fixture(autouse=True)
def max_pressure(monkeypatch):
    monkeypatch.setitem(LOADINGS, "max_pressure", PrescribedMaxPressure)


def test_prescribed_quantity_has_no_grid_error():
    solution = solve(ball(64), max_pressure=2000)
    assert solution.converged and solution.max_pressure == pytest.approx(2000, rel=1e-3)
    assert solution.max_pressure_error == 0 < solution.load_error
    assert solve(ball(64), load=solution.load).max_pressure == pytest.approx(2000, rel=1e-3)


def test_search_ends_when_all_cells_are_plastic():
    problem = ball(32, hardness=1000)
    with pytest.warns(RuntimeWarning, match="no approach has this max_pressure"):
        solution = solve(problem, max_pressure=2000)
    assert not solution.converged and solution.max_pressure == 1000
    assert solution.load == pytest.approx(1000 * problem.grid.area)


def test_search_is_refused_on_a_periodic_patch():
    with pytest.raises(InputError, match="max_pressure: not on a patch periodic in x and y"):
        solve(ball(32, periodic=True), max_pressure=2000)


def test_number_that_depends_on_the_pressure_is_refused_if_another_one_is_solved_for():
    with pytest.raises(InputError, match="max_pressure: not with a background pressure; use"):
        solve(ball(32, background_pressure=20.0), max_pressure=2000)
    rubber = Material.pair((10, 2e5), (0.5, 0.3)).viscoelastic(times=(0.1,), moduli=(0.3,))
    with (
        ContactSolver(ball(32, rubber)) as solver,
        pytest.raises(InputError, match="max_pressure: not with creep"),
    ):
        solver.creep([0, 1], max_pressure=1.0)
