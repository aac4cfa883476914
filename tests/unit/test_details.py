"""Details of several modules: switches, limits, and what is restored afterwards."""

import math
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough
from mpi4py import MPI
from running import solve

from app import ContactProblem, ContactSolver
from app.api import strategy
from app.api.refinement import refine
from app.base import petsc
from app.base.errors import InputError
from app.cli.monitor import Progress
from app.contact.certificate import certify
from app.contact.distance import UndeformedDistance
from app.contact.grid_errors import GridNumbers, estimate_errors
from app.contact.history import Listener
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement, Gaps
from app.halfspace.grid import Grid
from app.halfspace.influence import Material, dense_matrix
from app.halfspace.operator import InfluenceOperator, wrap_vec
from app.halfspace.product import DenseProduct
from app.methods.free.lift import lift
from app.methods.periodic import stencil
from app.methods.stopping import IN_CONTACT, ROUNDING_RESIDUAL, InexactStop
from app.multigrid.hierarchy import Hierarchy


def test_grids_worked_on_in_windows_get_no_product_before_somebody_asks():
    windowed = Hierarchy(Grid(128, 128, 0.1, 0.1), 1.0, MPI.COMM_SELF, margin=0.1)
    assert [level.grid.nx for level in windowed.levels if "product" not in vars(level)] == [128]
    assert "exact_product" in vars(windowed.target)
    assert windowed.operator_applications() == 0
    whole = Hierarchy(Grid(128, 128, 0.1, 0.1), 1.0, MPI.COMM_SELF)
    assert all("product" in vars(level) for level in whole.levels)


@pytest.mark.parametrize("kind", ["tao", "snesvi"])
def test_history_of_a_reference_solver_has_every_iteration(kind):
    found = solve(hertz(12), APPROACH, None, lcp_type=kind)
    history = found.history
    assert list(history["iteration"]) == list(range(1, found.iterations + 1))
    assert sum(history["inner_iterations"]) == found.inner_iterations
    assert history["residual"][-1] == pytest.approx(found.residual, rel=1e-12)
    assert history["contact_cells"][-1] == np.count_nonzero(found.contact)


@pytest.mark.parametrize("kind", ["tao", "snesvi"])
def test_a_second_solve_of_a_reference_solver_counts_its_own_work_alone(kind):
    with ContactSolver(hertz(12), options={"lcp_type": kind}) as solver:
        first, second = (solver.solve(approach=APPROACH) for _ in range(2))
    assert second.work_units == first.work_units > 0
    assert second.inner_iterations == first.inner_iterations > 0


class Norms:
    """A state of which only the norms of h are asked for."""

    def __init__(self, whole, inside):
        self.distance, self._whole, self._inside = self, whole, inside

    def norm(self):
        return self._whole

    def on_contact(self, with_h):
        return Gaps(1, 0.0, 0.0, h=self._inside)


def test_a_contact_small_in_its_patch_is_solved_by_its_own_measure():
    stop = InexactStop(1e-6, 100)
    assert stop.allowed(Norms(10.0, 0.0)) == pytest.approx(1e-6 * 10)  # nothing there to measure
    assert stop.allowed(Norms(10.0, 5.0)) == pytest.approx(1e-6 * 10)
    assert stop.allowed(Norms(10.0, 1e-3)) == pytest.approx(IN_CONTACT * 1e-6 * 1e-3)
    assert InexactStop(1e-15, 100).allowed(Norms(10.0, 1e-3)) == pytest.approx(
        min(1e-14, ROUNDING_RESIDUAL * 1e-3)
    )


def test_lift_is_trusted_and_does_not_ask_for_the_unit_of_pressure(monkeypatch):
    grid, shape, trusted, found = hertz(32).grid, hertz(32).shape, [], []
    monkeypatch.setattr(strategy.lift, "lift", lambda *of: trusted.append(lift(*of)) or trusted[-1])
    for modulus in (82000.0, 82e-8):
        problem = ContactProblem(grid, Material.combined(modulus, 0.28), shape)
        found.append(solve(problem, APPROACH, "fmg_lift"))
    assert trusted and all(trusted)
    np.testing.assert_array_equal(found[0].contact, found[1].contact)
    assert found[0].history["changed_cells"] == found[1].history["changed_cells"]


def test_a_product_counts_once():
    grid = Grid(3, 2, 1.0, 1.0)
    product, p = DenseProduct(dense_matrix(grid, 1.0), grid.shape), np.ones(grid.shape)
    product.apply(p, np.empty_like(p))
    product.apply(p, np.empty_like(p), p > 0)
    assert product.count == 2


class Hears(Listener):
    """Notes what it is told."""

    def __init__(self):
        self.told = []

    def begin(self, settings):
        self.told.append(settings.rtol)

    def start(self, state, level):
        self.told.append("start")

    def iteration(self, entry, state):
        self.told.append(entry["iteration"])

    def end(self):
        self.told.append("end")


def test_listeners_hear_of_every_iteration():
    hears = Hears()
    with ContactSolver(hertz(12), "norm", {"lcp_rtol": 1e-5}, listeners=[hears]) as solver:
        found = solver.solve(approach=APPROACH)
    assert hears.told == [1e-5, "start", *found.history["iteration"], "end"]


@pytest.mark.parametrize("listeners", [[print], [Hears], [None], Hears(), 3])
def test_what_is_no_listener_is_refused_before_any_work(listeners):
    with (
        mock.patch("app.api.solver.make_hierarchy", side_effect=AssertionError),
        pytest.raises(InputError, match="^listeners: is .*; needed: .*app.Listener$"),
    ):
        ContactSolver(hertz(12), listeners=listeners)


def test_each_solve_has_a_bar_of_its_own():
    """As those of a refinement, which share their listeners."""
    with (
        mock.patch("tqdm.tqdm") as bar,
        ContactSolver(hertz(12), "norm", listeners=[Progress()]) as solver,
    ):
        for opened in (1, 2):
            solver.solve(approach=APPROACH)
            assert bar.call_count == bar.return_value.close.call_count == opened


def test_a_bar_is_full_where_its_solve_ends():
    """At the tolerance of its grid, which a refinement tightens."""
    full = []
    with mock.patch("tqdm.tqdm") as bar:
        bar.return_value.close.side_effect = lambda: full.append(bar.return_value.n)
        options, listeners = {"lcp_rtol": 1e-3}, [Progress()]
        refine(hertz(12), 1e-6, 24**2, "norm", options, listeners=listeners, approach=APPROACH)
    assert full == [100, 100]


@pytest.mark.parametrize("method", ["norm", None])
def test_the_monitor_prints_the_history_of_each_solve(method, capsys):
    """Also in a program, which has no other way to ask for it than the option."""
    with ContactSolver(hertz(12), method, options={"lcp_monitor": True}) as solver:
        for _ in range(2):
            history = solver.solve(approach=APPROACH).history
            rows = [line.split() for line in capsys.readouterr().out.splitlines()]
            assert rows[0][:3] == ["level", "it", "inner"]
            printed = [(row[0], row[1], row[3]) for row in rows if row[0] != "level"]
            columns = (map(str, history[name]) for name in ("level", "iteration", "contact_cells"))
            assert printed == list(zip(*columns, strict=True))


def test_the_bar_of_a_solver_that_diverges():
    with mock.patch("tqdm.tqdm") as bar:
        progress = Progress()
        progress.begin(SimpleNamespace(rtol=1e-6, monitor=False))
        progress.start(None, 0)
        for residual, done in ((math.nan, 0), (math.inf, 0), (1e-3, 50), (0.0, 100)):
            progress.iteration({"residual": residual, "level": 0, "iteration": 1, "contact_cells": 1}, None)
            assert bar.return_value.n == done


def test_differences_of_grids_that_do_not_fall_are_an_error_of_all():
    def error(*pressures):
        grids = [GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures]
        return estimate_errors(grids, 0.0, "load")

    slow = error(1.0, 2.0, 3.0, 4.0).max_pressure_error
    assert slow == error(0.5, 1.0, 2.0, 3.0, 4.0).max_pressure_error == 1.0
    assert error(1.0, 2.0, 2.5, 2.75).max_pressure_error < 1.0


def test_certificate_names_the_smallest_pressure():
    operator = InfluenceOperator(Grid(4, 1, 1.0, 1.0), 1.0)
    state = contact_state(operator, UndeformedDistance(operator, np.array([[0.0, 1.0, 2.0, np.nan]])))
    with state.pressure as p:
        p[:] = 3.0, -0.25, 0.5, 0.0
    assert certify(state).smallest_pressure == -0.25


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("p", "smallest"), [((3.0, -0.25, 0.5, 0.0), -0.25), ((3.0, 0.5, 0.0, 0.5), -0.5)])
def test_nothing_is_proved_of_a_pressure_that_is_not_allowed(periodic, p, smallest):
    """Negative, or where there can be none; what rounding makes negative is nothing."""
    operator = InfluenceOperator(Grid(4, 1, 1.0, 1.0, periodic=periodic), 1.0)
    for share, bounded in (1.0, False), (1e-16, True):
        state = contact_state(operator, UndeformedDistance(operator, np.array([[0.0, 1.0, 2.0, np.nan]])))
        with state.pressure as values:
            values[:] = [p[0], *(share * value for value in p[1:])]
        state.displacement_status = Displacement.STALE
        found = certify(state)
        assert np.isfinite(found.error_bound) == bounded
        assert found.smallest_pressure == pytest.approx(share * smallest)


@pytest.mark.parametrize("periodic", [False, True])
def test_nothing_is_proved_of_a_pressure_that_is_no_number(periodic):
    operator = InfluenceOperator(Grid(4, 2, 1.0, 1.0, periodic=periodic), 1.0)
    state = contact_state(operator, UndeformedDistance(operator, np.arange(8.0).reshape(2, 4)))
    with state.pressure as p:
        p[:2] = 1.0, np.nan
    found = certify(state)
    assert found.error_bound == np.inf
    assert np.isnan([found.duality_gap, found.largest_penetration, found.smallest_pressure]).all()


def test_a_vec_is_in_the_memory_of_its_field():
    operator = InfluenceOperator(Grid(3, 2, 1.0, 1.0), 1.0)
    with pytest.raises(ValueError, match="C-contiguous"):
        wrap_vec(np.zeros((2, 3), order="F"), operator)
    field = np.zeros((2, 3))
    vec = wrap_vec(field, operator)
    vec.set(1.0)
    assert (field == 1).all()
    vec.destroy()


def test_listeners_hear_the_end_of_a_solve_that_is_refused():
    hears = Hears()
    with ContactSolver(hertz(12), listeners=[hears]) as solver, pytest.raises(InputError):
        solver.solve(load=-1)
    assert hears.told[-1] == "end"


@pytest.mark.parametrize("kind", [32, 32 | 16, 64, 128])
def test_sweeps_by_parts_of_the_matrix_are_refused(kind):
    """SOR_EISENSTAT and its like; x as it was would be taken for an answer."""
    operator = InfluenceOperator(Grid(4, 3, 1.0, 1.0), 1e-5)
    with pytest.raises(ValueError, match="by parts of the matrix"):
        operator.SOR(None, None, 1.0, kind, 0.0, 1, 1, None)


def test_preconditioners_that_need_the_matrix_are_refused():
    with pytest.raises(InputError, match="-pc_type eisenstat"):
        ContactSolver(hertz(12), "norm", {"pc_type": "eisenstat"})


@pytest.mark.parametrize("loop", ["add_centre", "residual_in_cells"])
def test_without_rows_nothing_is_read(loop):
    """On ranks without rows; the row before the first one would be before the array."""
    none, weights = np.zeros((0, 4)), (1.0, *(np.float32(0),) * 3)
    given = {
        "add_centre": (none, none, none, weights, np.zeros((3, 6)), none),
        "residual_in_cells": (
            none, none > 0, weights, none, none, none, none, 0, (1, 1), np.zeros((3, 6)), np.zeros(4),
        ),
    }  # fmt: skip
    getattr(stencil, loop).py_func(*given[loop])


def test_the_gap_waits_for_a_solve_in_another_thread():
    found = solve(hertz(12), APPROACH)
    with ThreadPoolExecutor(1) as pool:
        with petsc._LOCK:
            gap = pool.submit(lambda: found.gap)
            with pytest.raises(TimeoutError):
                gap.result(0.05)
        assert gap.result().shape == found.pressure.shape


@pytest.mark.parametrize("method", ["fmg_v11", "norm", None])
def test_products_of_the_certificate_count(method):
    with ContactSolver(periodic_rough(32), method) as solver:
        before = solver.hierarchy.operator_applications()
        found = solver.solve(load=30.0)
        assert found.operator_applications == solver.hierarchy.operator_applications() - before


def test_tao_begins_with_what_it_is_given():
    with ContactSolver(hertz(16), options={"lcp_type": "tao"}) as solver:
        first = solver.solve(approach=APPROACH)
        again = solver.solve(approach=APPROACH, start=first)
    assert again.operator_applications < first.operator_applications / 2
    assert again.load == pytest.approx(first.load, rel=1e-5)


def test_what_is_no_loading_is_refused():
    with ContactSolver(hertz(12)) as solver, pytest.raises(InputError, match="exactly one"):
        solver.check(force=1.0)
