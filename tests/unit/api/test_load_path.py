"""Load paths: rows that depend on their own load alone, laws along the path, refusals before any work."""

import csv
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough, punch, self_affine

from app import ContactProblem, ContactSolver, Grid, Listener, Material, Sphere
from app.api.load_path import _slope
from app.base.errors import InputError


def same(one, other):
    """Whether two tables are the same to the last digit."""
    return one.keys() == other.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=True) for name in one
    )


def test_a_missing_attribute_is_named_with_a_similar_one():
    with ContactSolver(hertz(16)) as solver:
        path = solver.path(load=[10, 20])
        list(path)
    for name, hint in (
        ("tabel", "did you mean table"),
        ("max_pressure", r"path.table\['max_pressure'\] has"),
    ):
        with pytest.raises(AttributeError, match=f"this path has no {name}; {hint}"):
            getattr(path, name)


def test_load_of_hertz_grows_with_approach_to_the_power_of_three_halves():
    with ContactSolver(hertz(128)) as solver:
        path = solver.path(approach=np.geomspace(0.02, 0.15, 5))
        assert [round(solution.approach, 6) for solution in path] == list(np.round(path.table["approach"], 6))
    table = path.table
    exponent, _ = np.polyfit(np.log(table["approach"]), np.log(table["load"]), 1)
    assert exponent == pytest.approx(1.5, abs=1e-3)
    inside = slice(1, -1)
    known = 1.5 * table["load"] / table["approach"]
    assert table["stiffness_by_differences"][inside] == pytest.approx(known[inside], rel=0.03)
    assert path.converged


def test_repeated_loads_have_the_same_slope():
    with ContactSolver(hertz(32)) as solver:
        path, up = solver.path(approach=[0.05, 0.1, 0.2, 0.1, 0.05]), solver.path(approach=[0.05, 0.1, 0.2])
        assert len(list(path)) == 5 and len(list(up)) == 3
    slopes, expected = (one.table["stiffness_by_differences"] for one in (path, up))
    assert np.isfinite(expected).all() and list(slopes) == [*expected, *expected[1::-1]]


def test_stiffness_by_differences_is_zero_before_first_touch():
    approach = np.array([-1.0, 0.0, 1.0])
    slope = _slope(approach, np.maximum(approach, 0) ** 1.5)
    assert slope[0] == 0 and (slope[1:] > 0).all()
    assert _slope(approach, (approach + 1) ** 2) == pytest.approx([0, 2, 4])  # the parabola's own


def test_every_step_has_its_stiffness_and_the_analytic_values(tmp_path):
    with ContactSolver(hertz(32)) as solver:
        path = solver.path(approach=[-1.0, 0.05, 0.1], stiffness=True)
        steps = [solution.attributes for solution in path]
    path.save(tmp_path / "path.csv")
    with (tmp_path / "path.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0].keys() == path.table.keys()
    assert [float(row["stiffness"]) for row in rows] == [step["stiffness"] for step in steps]
    assert np.isnan(path.table["analytic_load"][0])
    assert [float(row["analytic_load"]) for row in rows[1:]] == [step["analytic_load"] for step in steps[1:]]
    assert (path.table["conductance_width"] == path.table["stiffness"] / steps[0]["contact_modulus"]).all()
    assert path.table["stiffness"][2] == pytest.approx(path.table["analytic_stiffness"][2], rel=0.05)


def test_wrong_uses_of_a_path_are_explained(tmp_path):
    with ContactSolver(hertz(16)) as solver:
        path = solver.path(approach=[0.05, 0.1])
        for use in (lambda: path.table, lambda: path.save(tmp_path / "path.csv")):
            with pytest.raises(InputError, match="no step is solved yet: iterate over it first"):
                use()
        next(iter(path))
        assert len(path.table["load"]) == 1
        assert len(list(path)) == 1
        with pytest.raises(InputError, match="has been iterated over, and its solutions are not kept"):
            list(path)
    with pytest.raises(InputError, match=r"must end in .csv; .*steps=path.table"):
        path.save(tmp_path / "path.h5")
    with pytest.raises(InputError, match=r"none/path.csv: cannot be written: No such file or directory$"):
        path.save(tmp_path / "none/path.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("problem", "loading"),
    [
        (self_affine(64), {"load": [3.0, 300.0, 30.0]}),
        (periodic_rough(64), {"mean_pressure": [3000.0, 10.0, 1e6, 300.0]}),
        (hertz(64), {"approach": [0.1, 0.01, -1.0, 0.05]}),
    ],
    ids=["free", "periodic", "hertz"],
)
def test_a_resumed_path_has_the_same_table(problem, loading):
    with ContactSolver(problem) as solver:
        path = solver.path(stiffness=True, **loading)
        fields = [solution.pressure for solution in path]
    with ContactSolver(problem) as solver:
        solver.solve(approach=-1e-3)  # moves the bodies
        rest = solver.path(stiffness=True, rows=path.rows[:2], **loading)
        assert np.array_equal([solution.pressure for solution in rest], fields[2:])
        again = solver.path(stiffness=True, rows=path.rows, **loading)
        assert np.array_equal([solution.pressure for solution in again], fields[-1:])
    assert same(rest.table, path.table)
    assert same(again.table, path.table)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError, ZeroDivisionError])
def test_an_interrupted_path_resumes_with_the_same_step(error):
    class Stops(Listener):
        after = None

        def iteration(self, entry, state):
            if self.after is not None and len(path.rows) == self.after:
                raise error

    stops, loads = Stops(), [10.0, 3000.0, 300.0, 20.0]
    with ContactSolver(hertz(32), listeners=[stops]) as solver:
        path = whole = solver.path(load=loads)
        list(path)
        path = solver.path(load=loads)
        for stops.after in range(4):
            with pytest.raises(error):
                list(path)
            assert len(path.rows) == stops.after
        stops.after = None
        assert len(list(path)) == 1
        assert same(path.table, whole.table)
        with pytest.raises(InputError, match="has been iterated over"):
            list(path)
        path = solver.path(load=loads)
        next(iter(path))
        solver.update(hertz(32))
        for _ in range(2):  # it is not the problem that the rows are of
            with pytest.raises(InputError, match="make a new path"):
                next(iter(path))


def test_the_table_marks_unconverged_steps():
    with warnings.catch_warnings(), ContactSolver(punch(32), "norm", {"lcp_max_it": 1}) as solver:
        warnings.simplefilter("ignore", RuntimeWarning)
        path = solver.path(approach=[-1.0, 0.1])
        list(path)
    assert list(path.table["converged"]) == [True, False]
    assert not path.converged


@pytest.mark.parametrize("kind", ["load", "mean_pressure", "approach", "mean_gap"])
def test_rows_of_other_loads_are_refused(kind):
    numbers = {"approach": [-0.1, -0.02, -0.001], "mean_gap": [0.02, 0.005, 0.0]}.get(
        kind, [1.0, 50.0, 400.0]
    )
    with ContactSolver(periodic_rough(32)) as solver:
        path = solver.path(**{kind: numbers})
        list(path)
        assert len(solver.path(rows=path.rows, **{kind: numbers}).rows) == 3
        assert len(solver.path(rows=path.rows, **{kind: [*numbers, numbers[0]]}).rows) == 3
        other = [numbers[0], numbers[1] + 1e-5, numbers[2]]
        with pytest.raises(InputError, match=f"^path: rows: step 2 has {kind} {numbers[1]:g}, this path "):
            solver.path(rows=path.rows, **{kind: other})
        with pytest.raises(InputError, match="step 1 has "):
            solver.path(rows=path.rows[1:], **{kind: numbers})
        for value in "x", None, [1.0]:
            with pytest.raises(InputError, match="rows: must be the .rows. of an earlier path"):
                solver.path(rows=[path.rows[0] | {"max_pressure": value}], **{kind: numbers})
        missed = [path.rows[0], path.rows[1] | {"converged": False}]
        assert len(solver.path(rows=missed, **{kind: other}).rows) == 2


REFUSED = {
    "none": ({}, "path: exactly one of approach"),
    "two": ({"load": [1], "approach": [1]}, "exactly one of"),
    "unknown": ({"force": [1]}, "exactly one of"),
    "empty": ({"load": []}, r"one number or more \[N\]"),
    "no numbers": ({"load": ["many"]}, r"load: is str; must be a number \[N\]"),
    "a number": ({"load": 5}, "one number or more"),
    "negative": ({"load": [1, -1]}, "load -1: must be at least 0 N"),
    "mean gap": ({"mean_gap": [1]}, "only on a periodic patch"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_loading_is_refused_before_any_step(case):
    loadings, message = REFUSED[case]
    with ContactSolver(hertz(16)) as solver, pytest.raises((InputError, TypeError), match=message):
        solver.path(**loadings)


def test_start_and_solution_of_another_grid_are_refused():
    with ContactSolver(hertz(16)) as solver, ContactSolver(hertz(32)) as other:
        start = other.solve(approach=APPROACH)
        with pytest.raises(InputError, match="start: must be a Solution on the same grid"):
            solver.solve(approach=APPROACH, start=start)
        with pytest.raises(InputError, match="solution: must be a Solution on the same grid"):
            solver.stiffness(start)


@pytest.mark.parametrize("meanwhile", ["another path", "the same problem", "far away"])
def test_other_solves_between_steps_change_nothing(meanwhile):
    problem, loads = hertz(32), [10.0, 20.0, 30.0]
    with ContactSolver(problem) as solver:
        expected = [solution.approach for solution in solver.path(load=loads)]
        path, other = solver.path(load=loads), iter(solver.path(approach=[0.001, 0.002, 0.003]))
        found = []
        for solution in path:
            found.append(solution.approach)
            if meanwhile == "another path":
                next(other)
            elif meanwhile == "the same problem":
                solver.update(problem)
            else:
                for approach in (50.0, 0.001):
                    solver.solve(approach=approach)
    assert found == expected


def test_a_path_of_a_closed_solver_raises():
    with ContactSolver(hertz(16)) as solver:
        path = solver.path(load=[10.0, 20.0])
        steps = iter(path)
        next(steps)
    assert repr(path) == "<LoadPath: 2 steps by load, 1 done>"
    with pytest.raises(InputError, match="the solver is closed"):
        next(steps)


def test_another_thread_solves_the_problem_itself_while_a_path_changes_it():
    """The steps of creep and of unloading change the solver's problem; no other solve sees that."""
    grid, steel = Grid.from_domain(16, 16, (-0.5, 0.5, -0.5, 0.5)), Material.isotropic(210e3, 0.3)
    creeping = ContactProblem(grid, steel.viscoelastic(1, 0.5), Sphere(10))
    unloaded = ContactProblem(grid, steel, Sphere(10), hardness=800)
    for problem in creeping, unloaded:
        with ContactSolver(problem) as solver, ThreadPoolExecutor(1) as pool:
            if problem is creeping:
                path = solver.creep(range(20), load=100)
            else:
                path = solver.path(load=[100, *np.linspace(90, 10, 19)])
            alone = solver.solve(load=50).approach
            work = pool.submit(list, path)
            others = []
            while not work.done():
                others.append(solver.solve(load=50).approach)
            assert len(work.result()) == 20
        np.testing.assert_allclose(others, alone, rtol=1e-9)
