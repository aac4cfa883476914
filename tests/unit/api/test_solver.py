"""The solver: independence of solves, interrupts, updates, memory."""

import gc
import pickle
import re
import tracemalloc
import warnings
import weakref
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
import pytest
from cases import APPROACH, hertz, punch
from petsc4py import PETSc
from running import assert_proved_equal, assert_solves_lcp

import app
from app import ContactProblem, ContactSolver, Grid, Listener, Material, Sphere, solve
from app.api.subsurface import stress
from app.base.errors import InputError
from app.contact import measures
from app.contact.distance import UndeformedDistance
from app.contact.state import ContactState
from app.halfspace.fft.multiplier import EvenMultiplier

from .solvers import METHODS, assert_same, each_method, problem_of, solver_of


def copy_of(solution):
    return {name: getattr(solution, name).copy() for name in ("pressure", "displacement", "contact", "gap")}


@pytest.fixture
def products_left(monkeypatch):
    """A list of a number: so many products from now on is an interrupt; 0: never."""
    apply, left = EvenMultiplier.apply, [0]

    def interrupted(*arguments, **named):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return apply(*arguments, **named)

    monkeypatch.setattr(EvenMultiplier, "apply", interrupted)
    return left


@each_method
@pytest.mark.parametrize("number", [2, 9, 17])
def test_a_solver_can_be_used_after_an_interrupt(method, number, products_left):
    with solver_of(method) as solver:
        expected = solver.solve(approach=0.1).pressure
        products_left[0] = number
        with pytest.raises(KeyboardInterrupt):
            solver.solve(approach=0.1)
        found = solver.solve(approach=0.1).pressure
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * expected.max())


@each_method
def test_an_interrupt_survives_garbage_collection(method, monkeypatch):
    """Python 3.12 may collect it while the exception is on its way through PETSc."""

    class Node:
        pass

    thresholds, kept = gc.get_threshold(), []

    def interrupted(*_, **__):
        node = Node()
        node.itself = node
        kept.append(weakref.ref(node, kept.remove))
        del node
        gc.set_threshold(1)  # the exception is one object too many
        raise KeyboardInterrupt

    with solver_of(method) as solver:
        monkeypatch.setattr(EvenMultiplier, "apply", interrupted)
        try:
            with pytest.raises(KeyboardInterrupt):
                solver.solve(approach=0.1)
        finally:
            gc.set_threshold(*thresholds)


@pytest.mark.parametrize("method", ["fast", "primal", "fmg"])
def test_interrupted_solves_free_their_fields(method, products_left):
    """PETSc keeps what Python forgets until somebody asks: the next solve does."""
    with solver_of(method, punch(128)) as solver:
        solver.solve(approach=0.1)
        tracemalloc.start()
        try:
            held = []
            for _ in range(3):
                for _ in range(5):
                    products_left[0] = 4
                    with pytest.raises(KeyboardInterrupt):
                        solver.solve(approach=0.1)
                    products_left[0] = 0
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
    assert max(np.diff(held)) < 8 * 128**2  # a field; it was one for every interrupt


def test_listeners_that_have_begun_are_ended():
    heard = []

    class Named(Listener):
        def __init__(self, name):
            self.name = name

        def begin(self, settings):
            heard.append(f"{self.name} begins")
            if self.name == "b":
                raise OSError

        def end(self):
            heard.append(f"{self.name} ends")

    with (
        ContactSolver(punch(24), listeners=[Named(name) for name in "abc"]) as solver,
        pytest.raises(OSError),
    ):
        solver.solve(approach=0.1)
    assert heard == ["a begins", "b begins", "a ends"]


def test_a_shape_is_sampled_once():
    calls = []

    def flat(x, y):
        calls.append(None)
        return np.where(np.hypot(x, y) < 1, 0.0, np.nan) + 0 * x * y

    with ContactSolver(
        ContactProblem(Grid.from_domain(32, 32, (-2, 2, -2, 2)), Material.combined(8e4, 0.3), flat)
    ) as solver:
        made = len(calls)
        loads = [solver.solve(load=load).load for load in (1.0, 2.0, 1e3)]
    assert loads == pytest.approx([1.0, 2.0, 1e3]) and len(calls) == made


@each_method
def test_a_solve_does_not_depend_on_earlier_ones(method):
    """What was solved before leaves no trace."""
    with solver_of(method) as once, solver_of(method) as again:
        expected = once.solve(approach=0.1)
        again.solve(approach=-0.15)
        assert_same(again.solve(approach=0.1), expected, rounding=1e-9)
        assert_same(once.solve(approach=0.1), expected)


@each_method
def test_solutions_are_unchanged_by_later_solves(method):
    with solver_of(method) as solver:
        first = solver.solve(approach=0.1)
        before = copy_of(first)
        solver.solve(approach=0.2)
        solver.solve(approach=-0.15, start=None if method == "snesvi" else first)
    gap = before.pop("gap")  # h is moved and moved back, with rounding
    np.testing.assert_allclose(first.gap, gap, rtol=0, atol=1e-15 * np.nanmax(abs(first.undeformed_distance)))
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(first, name), values)
    assert_solves_lcp(first)


def test_solvers_of_different_methods_coexist():
    expected = {
        method: solve(problem_of(method), approach=0.1, method=name, options=own)
        for method, (name, own) in METHODS.items()
    }
    solvers = {method: solver_of(method) for method in METHODS}
    for approach in (-0.1, 0.1):
        found = {method: solver.solve(approach=approach) for method, solver in solvers.items()}
    for method in METHODS:
        assert_same(found[method], expected[method], rounding=1e-9)
    for method in ("fmg", "fast", "primal", "norm", "snesvi", "mg"):  # not in the order they were made
        solvers.pop(method).close()
        for other in solvers.values():
            assert other.solve(approach=0.1).converged


@each_method
def test_options_without_a_prefix_are_ignored(method):
    database = PETSc.Options()
    database.setValue("ksp_rtol", "0.5")
    database.setValue("lcp_rtol", "nonsense")
    try:
        before = database.getAll()
        with solver_of(method) as solver:
            found = solver.solve(approach=0.1)
            assert database.getAll() == before
        assert database.getAll() == before
    finally:
        for name in ("ksp_rtol", "lcp_rtol"):
            database.delValue(name)
    with solver_of(method) as solver:
        assert_same(solver.solve(approach=0.1), found)


def test_an_unconverged_solve_warns_and_returns_a_solution():
    with pytest.warns(RuntimeWarning, match="not converged: .*not enough") as said:
        found = solve(punch(24), approach=0.1, method="norm", options={"lcp_max_it": 1})
    assert [warning.filename for warning in said if warning.category is RuntimeWarning] == [__file__]
    assert not found.converged
    assert found.iterations == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert solve(punch(24), approach=0.1).converged


def test_a_missed_load_is_not_proved():
    with pytest.warns(RuntimeWarning, match="not converged"):
        found = solve(punch(24), load=1e4, method="norm", options={"lcp_max_it": 3})
    assert abs(found.load - 1e4) > 10 and found.error_bound == np.inf
    assert solve(punch(24), load=1e4, method="norm").error_bound < 1e-3


@pytest.mark.parametrize("where", ["on_levels", "measure_roughness"])
def test_a_failed_update_keeps_the_old_problem(monkeypatch, where):
    def no_memory(*_):
        raise MemoryError

    other = ContactProblem(punch(24).grid, punch(24).material, lambda x, y: x**2 + y**2)
    with ContactSolver(punch(24)) as solver:
        before = solver.solve(load=1e4)
        with monkeypatch.context() as patch:
            patch.setattr(
                {"on_levels": UndeformedDistance, "measure_roughness": measures}[where], where, no_memory
            )
            with pytest.raises(MemoryError):
                solver.update(other)
        after = solver.solve(load=1e4)
    assert_proved_equal(after, before)


@pytest.mark.parametrize(
    "ask",
    {
        "solve": lambda solver: solver.solve(approach=0.1),
        "check": lambda solver: solver.check(approach=0.1),
        "path": lambda solver: solver.path(approach=[0.1]),
        "stiffness": lambda solver: solver.stiffness(None),
    }.values(),
)
def test_a_closed_solver_refuses_everything(ask):
    solver = ContactSolver(punch(24))
    solver.close()
    solver.close()
    with pytest.raises(InputError, match="closed"):
        ask(solver)


def worn(problem, seed=1):
    """The same bodies, a little of each cell gone."""
    gap = problem.shape_on(problem.grid)
    depth = np.nanmax(gap) - np.nanmin(gap)
    gap = gap + 0.01 * depth * np.random.default_rng(seed).random(gap.shape)
    return ContactProblem(problem.grid, problem.material, gap, periodic=bool(problem.grid.periodic))


def wavy(n=32):
    grid = Grid.from_domain(n, n, (0, 1, 0, 1))
    return ContactProblem(
        grid,
        Material.combined(80000, 0.3),
        lambda x, y: 0.01 * (2 - np.cos(2 * np.pi * x) - np.cos(2 * np.pi * y)),
        periodic=True,
    )


UPDATED = {
    "fast": (lambda: punch(40), None, {"approach": APPROACH}),
    "load": (lambda: hertz(40), None, {"load": 5000.0}),
    "windows": (lambda: hertz(160), None, {"approach": APPROACH}),
    "fmg": (lambda: punch(24), "fmg_v11", {"approach": APPROACH}),
    "norm": (lambda: punch(24), "norm", {"approach": APPROACH}),
    "periodic": (wavy, None, {"mean_pressure": 200.0}),
}


@pytest.mark.parametrize("case", UPDATED)
def test_an_updated_solver_solves_as_a_new_one(case):
    make, method, loading = UPDATED[case]
    problem = make()
    other = worn(problem)
    with ContactSolver(other, method) as fresh:
        expected = fresh.solve(**loading)
    with ContactSolver(problem, method) as solver:
        before = solver.solve(**loading)
        gap = before.gap.copy()
        solver.update(other)
        after = solver.solve(**loading)
        started = solver.solve(**loading, start=before)
        np.testing.assert_array_equal(before.gap, gap)
        solver.update(problem)
        again = solver.solve(**loading)
    for found, wanted in ((after, expected), (again, before)):
        assert (found.load, found.approach, found.iterations) == (
            wanted.load,
            wanted.approach,
            wanted.iterations,
        )
        np.testing.assert_array_equal(found.pressure, wanted.pressure)
        np.testing.assert_allclose(found.gap, wanted.gap, rtol=0, atol=1e-15)  # bodies were moved since
    assert_solves_lcp(started)
    assert started.load == pytest.approx(after.load, rel=1e-4)
    assert started.approach == pytest.approx(after.approach, rel=1e-4)
    assert after.problem == expected.problem


@pytest.mark.parametrize("periodic", [False, True], ids=["free", "periodic"])
@pytest.mark.parametrize("steps", [0.0, 1.0], ids=["flat", "terraces"])
def test_a_heavy_load_costs_a_later_light_one_no_digits(periodic, steps):
    """A flat body, or a terrace, is where its last digit says: those that a deep approach costs are its contact."""
    grid, material = Grid(16, 12, 1.0, 0.1), Material.combined(80000, 0.3)
    gap = steps * (np.arange(16 * 12).reshape(12, 16) % 7 > 3)
    gap[3:5, 2:6] = np.nan
    problem = ContactProblem(grid, material, gap, periodic=periodic)
    with ContactSolver(problem) as solver:
        first, heavy, again = (solver.solve(mean_pressure=p) for p in (1e-9, 1e5, 1e-9))
    assert first.converged and heavy.indentation > 1e12 * first.indentation
    assert (again.converged, again.approach, again.error_bound) == (True, first.approach, first.error_bound)
    np.testing.assert_array_equal(again.pressure, first.pressure)


@pytest.mark.parametrize(
    "other",
    [
        lambda: hertz(32),
        lambda: ContactProblem(hertz(24).grid, Material.combined(1.0, 0.3), np.zeros((24, 24))),
        lambda: ContactProblem(hertz(24).grid, hertz(24).material, np.full((24, 24), np.nan)),
        lambda: np.zeros((24, 24)),
    ],
    ids=["grid", "material", "holes", "array"],
)
def test_a_refused_update_keeps_the_old_problem(other):
    with ContactSolver(hertz(24)) as solver:
        before = solver.solve(approach=APPROACH)
        with pytest.raises(InputError, match=r"problem"):
            solver.update(other())
        assert_same(solver.solve(approach=APPROACH), before)


@pytest.mark.parametrize("periodic", [False, True])
def test_an_interrupted_move_of_the_bodies_is_undone(periodic, monkeypatch):
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), Sphere(10), periodic=periodic)

    def half_moved(state, depth):
        state._depth = state.neglected_gap = depth
        if depth:
            raise KeyboardInterrupt

    with ContactSolver(problem) as solver:
        before = solver.solve(load=100)
        with monkeypatch.context() as patch:
            patch.setattr(ContactState, "move_to", half_moved)
            with pytest.raises(KeyboardInterrupt):
                solver.solve(load=3)
        after = solver.solve(load=100)
    assert after.approach == pytest.approx(before.approach, rel=1e-9)
    assert after.load == pytest.approx(before.load, rel=1e-12)


STEEL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
BALL = ContactProblem(GRID, STEEL, Sphere(10))


@pytest.mark.parametrize("number", [2, Fraction(2), np.float32(2), np.int8(2), np.array(2.0), np.array(2)])
def test_any_real_number_is_a_load(number):
    assert solve(BALL, load=number).load == solve(BALL, load=2.0).load


def test_threads_may_share_a_solver():
    loads = [1.0, 2.0, 3.0, 4.0]
    alone = [solve(BALL, load=load).max_pressure for load in loads]
    with ThreadPoolExecutor(4) as pool, ContactSolver(BALL) as shared:
        of_one = [pool.submit(shared.solve, load=load) for load in loads]
        of_each = [pool.submit(solve, BALL, load=load) for load in loads]
        for found in (of_one, of_each):
            np.testing.assert_allclose([one.result().max_pressure for one in found], alone, rtol=1e-6)


def test_a_solver_cannot_be_pickled():
    with ContactSolver(BALL) as solver, pytest.raises(TypeError, match="its problem can"):
        pickle.dumps(solver)
    there = solve(pickle.loads(pickle.dumps(BALL)), load=5)
    assert repr(pickle.loads(pickle.dumps(there))) == repr(there)
    assert "load 5 N" in repr(there)


def test_repr_describes_a_solver():
    with ContactSolver(BALL) as solver:
        assert repr(solver) == "<ContactSolver: 8 x 6 cells>"
        found = solver.solve(load=5)
    assert repr(solver) == "<ContactSolver: 8 x 6 cells, closed>"
    assert repr(stress(found, 0.3)) == "<SubsurfaceStress: below 8 x 6 cells, nu = 0.3>"


def test_public_names_and_parameters_are_documented():
    assert dir(app) == sorted(app.__all__)
    for name in ("approach", "load", "method", "options", "comm", "start", "mean_pressure", "mean_gap"):
        assert re.search(rf"^ *(\w+, )*{name}(, \w+)* : ", solve.__doc__, re.MULTILINE)


@pytest.mark.parametrize("periodic", [False, "y", True])
@pytest.mark.parametrize("loading", ["load", "approach"])
def test_bodies_that_just_touch_have_neither_contact_area_nor_stiffness(periodic, loading):
    """The cells that touch at first depend on the grid only."""
    grid = app.Grid.from_domain(16, 16, (-1, 1, -1, 1), periodic)
    problem = app.ContactProblem(grid, app.Material.isotropic(210e3, 0.3), app.Sphere(10), hardness=500)
    with app.ContactSolver(problem) as solver:
        loaded, touching = solver.path(load=[200, 0], stiffness=True)
        first = solver.with_stiffness(solver.solve(**{loading: 0}))
        again = solver.solve(load=200, start=first)
    for solution in (first, touching):
        assert solution.converged and not solution.contact.any()
        assert solution.contact_area == solution.stiffness == solution.conductance_width == 0
    np.testing.assert_allclose(again.pressure, loaded.pressure, atol=1e-4 * loaded.max_pressure)


class Skew:
    """Preconditioner that is not symmetric."""

    def apply(self, pc, x, y):
        values = x.getArray(readonly=True)
        y.setArray(2 * np.roll(values, 3) - 3 * np.roll(values, 1) + values * np.linspace(-1, 1, values.size))


@pytest.mark.parametrize("method", ["fast", "norm"])
def test_a_preconditioner_that_is_not_definite_is_named_as_the_cause(method):
    options = {"pc_type": "python", "pc_python_type": f"{__name__}.Skew"}
    grid = Grid.from_domain(32, 32, (-0.4, 0.4, -0.4, 0.4))
    ball = ContactProblem(grid, Material.isotropic(2e5, 0.3), Sphere(10))
    with pytest.warns(
        RuntimeWarning, match="not converged: .* not symmetric positive definite, (as -ksp|which CG)"
    ):
        solve(ball, load=100, method=method, options=options)
