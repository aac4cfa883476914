"""The cache of linear solvers between solves."""

import re
import sys

import numpy as np
import pytest
from cases import bowl, hertz
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, Listener, Material
from app.multigrid import solver_cache
from app.multigrid.linear_solver import LinearSolver

MAKES = re.compile(r"^(Vec|Mat|KSP|PC|IS)\.(create|duplicate|setFromOptions)|\.set_kernel$|\.set_spectrum$")


def test_second_solve_makes_no_solvers_or_spectra(created):
    with ContactSolver(bowl(160)) as solver:
        first = solver.solve(approach=0.3)
        assert created
        created.clear()
        second = solver.solve(approach=0.3)
        assert not created
        assert second.operator_applications == pytest.approx(first.operator_applications, abs=0.2)
        assert_proved_equal(second, first)


def test_large_windows_keep_their_spectra_only(created, monkeypatch):
    monkeypatch.setattr(solver_cache, "MAX_CACHED_CELLS", 0)
    with ContactSolver(bowl(160)) as solver:
        solver.solve(approach=0.3)
        created.clear()
        solver.solve(approach=0.3)
        assert set(created) == {"__init__"}
        solver.solve(approach=0.1)
        assert "set_kernel" in created


def calls_of(function):
    """Return the names of all Python and C functions called; from numba 0.57 on also of compiled loops."""
    names = []

    def hear(frame, event, arg):
        if event == "c_call":
            names.append(arg.__qualname__)
        elif event == "call" and "__name__" in frame.f_globals:
            names.append(frame.f_code.co_qualname)

    sys.setprofile(hear)
    try:
        function()
    finally:
        sys.setprofile(None)
    return names


@pytest.mark.parametrize("method", [None, "fmg_v11", "fmg_lift", "norm"])
def test_second_solve_makes_two_vecs_per_level_only(method):
    with ContactSolver(bowl(160), method) as solver:
        solver.solve(approach=0.3)
        made = [name for name in calls_of(lambda: solver.solve(approach=0.301)) if MAKES.search(name)]
        assert set(made) <= {"Vec.createWithArray", "Vec.duplicate"}
        assert len(made) <= 2 * len(solver.hierarchy.levels)


def test_small_grids_take_few_python_calls():
    """Earlier versions took 5,300 calls by approach and 4,700 by load."""
    with ContactSolver(hertz(64)) as solver:
        load = solver.solve(approach=0.1091).load
        assert len(calls_of(lambda: solver.solve(approach=0.1091))) < 3000
        solver.solve(load=load)  # imports
        assert len(calls_of(lambda: solver.solve(load=load))) < 3800


class Stops(Listener):
    """Raises once, after some iterations."""

    def __init__(self, after):
        self.left = after

    def iteration(self, entry, state):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_work_of_an_interrupted_solve_is_not_counted(kind):
    value = {"approach": 0.01, "load": 0.05}[kind]
    with ContactSolver(bowl(256)) as fresh:
        alone = fresh.solve(**{kind: value})
    last = len(alone.history["level"])
    with ContactSolver(bowl(256), listeners=[Stops(last)]) as solver:
        with pytest.raises(KeyboardInterrupt):
            solver.solve(**{kind: value})
        again = solver.solve(**{kind: value})
    assert again.operator_applications == pytest.approx(alone.operator_applications, rel=1e-12)


def test_solvers_of_periodic_patches_are_made_before_the_first_solve(monkeypatch):
    made, plain = [], LinearSolver.__init__
    monkeypatch.setattr(
        LinearSolver, "__init__", lambda self, *a, **named: (made.append(self), plain(self, *a, **named))[1]
    )
    grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.combined(1.0, 0.0), bowl(64).gap, periodic=True)
    with ContactSolver(problem) as solver:
        assert len(made) == len(solver.hierarchy.levels)
        made.clear()
        first, second = (solver.solve(load=0.01) for _ in range(2))
        assert not made
        np.testing.assert_array_equal(first.pressure, second.pressure)
