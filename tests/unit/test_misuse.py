"""What a program may hand over by mistake is refused in a line, or does what it says; nothing of it is overlooked."""

import math
import pickle
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import app
from app import (
    ContactProblem,
    ContactSolver,
    Grid,
    Material,
    SelfAffineSurface,
    Sphere,
    read_result,
    refine,
    solve,
)
from app.base.errors import InputError
from app.cli.subsurface import stress
from app.halfspace.stress.subsurface import SubsurfaceStress
from app.options.option_table import Option, OptionReader, domain, series
from app.problems.problem import Problem

STEEL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
HEIGHTS = np.random.default_rng(3).random(GRID.shape) * 1e-3
ROUGH = SelfAffineSurface(0.8, 1, 1, (3, 3), 1, rms_height=1e-4)
BALL = ContactProblem(GRID, STEEL, Sphere(10))


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        ("a relative error", lambda: refine(BALL, "0.1", load=1.0)),
        ("most_cells 'a'", lambda: refine(BALL, 0.1, load=1.0, most_cells="a")),
        ("most_cells nan", lambda: refine(BALL, 0.1, load=1.0, most_cells=np.nan)),
        ("unused option: -", lambda: ContactSolver(BALL, options={"": 2})),
        ("-ksp_view x: must be nothing, or ascii", lambda: ContactSolver(BALL, options={"ksp_view": "x"})),
        ("no folder", lambda: ContactSolver(BALL, options={"ksp_view": "ascii:nowhere/a"})),
        ("is a folder", lambda: ContactSolver(BALL, options={"ksp_view": ":.:ascii_info"})),
        ("no folder", lambda: ContactSolver(BALL, options={"ksp_converged_reason": ":nowhere/a"})),
        ("load: must be a list", lambda: ContactSolver(BALL).path(load="12")),
        ("load: must be a list", lambda: ContactSolver(BALL).path(load={1: 2})),
        ("numbers, texts, and arrays", lambda: solve(BALL, approach=0.001).save("x.h5", wear=[[1, 2], [3]])),
        ("'' cannot be a name", lambda: solve(BALL, approach=0.001).save("x.h5", **{"": 1})),
        ("'.' cannot be a name", lambda: solve(BALL, approach=0.001).save("x.h5", **{".": HEIGHTS})),
        ("rows: must be the .rows. of an", lambda: ContactSolver(BALL).path(load=[1, 2], rows=[{"a": 1}])),
        ("rows: must be the .rows. of an", lambda: ContactSolver(BALL).path(load=[1, 2], rows=3)),
        ("path table None: the name", lambda: ContactSolver(BALL).path(load=[1, 2]).save(None)),
        ("result file None: needed: a path", lambda: read_result(None)),
        ("body 0: allowed: 1, 2", lambda: stress(solve(BALL, approach=0.001), body=0)),
        (
            "x nan: must be a finite",
            lambda: stress(solve(BALL, approach=0.001), 0.3).line([0.1], np.nan, 0.0),
        ),
        ("y '0': must be a finite", lambda: stress(solve(BALL, approach=0.001), 0.3).section([0.1], y="0")),
        ("a ContactProblem", lambda: refine("x", 0.1, load=1)),
        ("one at least", lambda: stress(solve(BALL, approach=0.001), 0.3).line([], 0.0, 0.0)),
        ("read_result", lambda: stress("ball.h5")),
        ("whole numbers", lambda: Grid.from_domain(16.5, 12, (0, 1, 0, 1))),
        ("whole numbers", lambda: Grid(8.5, 8, 1.0, 1.0)),
        ("at least one cell", lambda: Grid(8, 0, 1.0, 1.0)),
        ("positive", lambda: Grid(8, 8, 0.0, 1.0)),
        ("finite", lambda: Grid(8, 8, 1.0, np.nan)),
        ("finite", lambda: Grid(8, 8, 1.0, 1.0, x0=np.inf)),
        ("finite", lambda: Grid(8, 8, 1.0, None)),
        ("spectral", lambda: Grid(8, 8, 1.0, 1.0, periodic="yes")),
        ("four numbers", lambda: Grid.from_domain(16, 12, "0,1,0,1")),
        ("a number", lambda: Material.from_contact_modulus("steel")),
        ("a ContactProblem", lambda: ContactSolver(HEIGHTS)),
        ("a mapping", lambda: ContactSolver(BALL, options=["lcp_rtol"])),
        ("names of options", lambda: ContactSolver(BALL, options={3: 8})),
        ("-lcp_rtol: must be names without", lambda: ContactSolver(BALL, options={"-lcp_rtol": 1e-8})),
        ("list of 3; allowed: .*ContactSolver.path", lambda: solve(BALL, load=[1, 2, 3])),
        ("approach: ndarray of 1; allowed: a number", lambda: solve(BALL, approach=np.array([1e-3]))),
        ("load: is MaskedConstant; needed: a number", lambda: solve(BALL, load=np.ma.masked)),
        ("approach: is str; needed: a number \\[mm\\]", lambda: solve(BALL, approach="1e-3")),
        ("approach: is bool; needed", lambda: solve(BALL, approach=True)),
        ("load: is bool_?; needed: a number \\[N\\]", lambda: solve(BALL, load=np.array(True))),
        ("mean_pressure: is bytes", lambda: solve(BALL, mean_pressure=b"1")),
        ("approach: is complex", lambda: solve(BALL, approach=1e-3 + 0j)),
        ("load inf: allowed: a number of size", lambda: solve(BALL, load=10**400)),
        ("load: is str", lambda: ContactSolver(BALL).path(load=[1, "2"])),
        ("method file", lambda: ContactSolver(BALL, method=3)),
        ("'own': is int; .*mapping", lambda: ContactSolver(BALL, method={"own": 3})),
        ("communicator", lambda: ContactSolver(BALL, comm=3)),
        ("no such file", lambda: read_result("nothing.h5")),
        ("from 0 to 0.5", lambda: SubsurfaceStress(HEIGHTS, GRID, "0.3")),
    ],
)
def test_is_refused_in_a_line(message, wrong):
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)


def test_masked_cells_of_a_field_are_missing_in_the_file(tmp_path):
    wear = np.ma.masked_greater(np.arange(48).reshape(GRID.shape), 7)
    solve(BALL, approach=0.001).save(tmp_path / "a.h5", wear=wear)
    np.testing.assert_array_equal(
        read_result(tmp_path / "a.h5").extra["wear"], wear.astype(float).filled(np.nan)
    )


@pytest.mark.parametrize("number", [2, Fraction(2), np.float32(2), np.int8(2), np.array(2.0), np.array(2)])
def test_any_real_number_is_a_load(number):
    assert solve(BALL, load=number).load == solve(BALL, load=2.0).load


def test_what_was_handed_over_stays_as_it_was():
    class Kept(Problem):
        sampled = True
        heights = HEIGHTS + 1.0

        def shape_on(self, grid, rows=slice(None)):
            return self.heights

    method = {"own": {"lcp_rtol": 1e-6, "lcp_predictor": 1}}
    first, second = (solve(Kept(GRID, STEEL), load=5, method=method) for _ in range(2))
    np.testing.assert_array_equal(Kept.heights, HEIGHTS + 1.0)
    assert second.approach == first.approach > 1.0
    assert method == {"own": {"lcp_rtol": 1e-6, "lcp_predictor": 1}}


def test_threads_get_what_one_gets_alone():
    loads = [1.0, 2.0, 3.0, 4.0]
    alone = [solve(BALL, load=load).max_pressure for load in loads]
    with ThreadPoolExecutor(4) as pool, ContactSolver(BALL) as shared:
        of_one = [pool.submit(shared.solve, load=load) for load in loads]
        of_each = [pool.submit(solve, BALL, load=load) for load in loads]
        for found in (of_one, of_each):
            np.testing.assert_allclose([one.result().max_pressure for one in found], alone, rtol=1e-6)


def test_a_solver_cannot_be_pickled_and_says_what_can():
    with ContactSolver(BALL) as solver, pytest.raises(TypeError, match="its problem can"):
        pickle.dumps(solver)
    there = solve(pickle.loads(pickle.dumps(BALL)), load=5)
    assert repr(pickle.loads(pickle.dumps(there))) == repr(there)
    assert "load 5 N" in repr(there)


def test_what_is_printed_at_a_prompt_says_what_it_is():
    with ContactSolver(BALL) as solver:
        assert repr(solver) == "<ContactSolver: 8 x 6 cells>"
        found = solver.solve(load=5)
    assert repr(solver) == "<ContactSolver: 8 x 6 cells, closed>"
    assert repr(stress(found, 0.3)) == "<SubsurfaceStress: below 8 x 6 cells, Poisson ratio 0.3>"


def test_a_result_read_is_as_good_as_the_solution(tmp_path):
    pair = Material.pair((210e9, 3e9), (0.3, 0.3))
    found = solve(ContactProblem(GRID, pair, Sphere(10)), load=5e7)
    found.save(tmp_path / "found.h5")
    saved = read_result(tmp_path / "found.h5")
    assert repr(saved) == repr(found).replace("Solution", "Result")
    assert repr(found).endswith(", 2 notes: see .notes>")
    for name in ("load", "iterations", "message", "rtol", "error_bound", "notes", "converged"):
        assert getattr(saved, name) == getattr(found, name)
    assert (*saved.grid.shape, saved.grid.dx, saved.grid.y0) == pytest.approx((*GRID.shape, GRID.dx, GRID.y0))
    assert saved.contact_patches() == pytest.approx(found.contact_patches())
    assert saved.attributes.keys() - found.attributes.keys() == {"contact_patches", "largest_patch"}
    assert (saved.attributes["contact_patches"], saved.largest_patch) == (
        1,
        pytest.approx(found.contact_area),
    )
    for name in ("pressure", "gap"):
        for one, other in zip(saved.distribution(name), found.distribution(name), strict=True):
            np.testing.assert_array_equal(one, other)
    assert repr(pickle.loads(pickle.dumps(saved))) == repr(saved)
    assert not hasattr(saved, "nothing")
    assert {"load", "pressure", "message"} <= set(dir(saved))


def test_what_there_is_can_be_looked_up():
    assert dir(app) == sorted(app.__all__)
    for name in ("approach", "load", "method", "options", "comm", "start", "mean_pressure", "mean_gap"):
        assert re.search(rf"^ *(\w+, )*{name}(, \w+)* : ", solve.__doc__, re.MULTILINE)


def test_columns_of_a_path_keep_their_order_in_the_file(tmp_path):
    solution = solve(BALL, load=5)
    columns = {"step": [1, 2], "load": [2.0, 5.0], "approach": [1e-3, 2e-3], "contact_area": [0.1, 0.2]}
    solution.save(tmp_path / "path.h5", steps=columns)
    with h5py.File(tmp_path / "path.h5") as file:
        assert list(file["path"]) == list(columns)
    assert list(read_result(tmp_path / "path.h5").path) == list(columns)


def test_without_load_a_touch_is_no_coarse_contact():
    coarse = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    ball = ContactProblem(coarse, STEEL, Sphere(10))
    assert not any("finer grid" in note for note in solve(ball, load=0).notes)
    assert any("finer grid" in note for note in solve(ball, load=1e-6).notes)


def test_a_periodic_patch_that_shows_nothing_of_the_bodies_is_worth_a_note():
    def notes(nx):
        grid = Grid.from_domain(nx, 1, (-1, 1, 0, 1))
        return solve(ContactProblem(grid, STEEL, lambda x, y: x**2, periodic=True), load=1).notes

    assert any("the same in all cells" in note for note in notes(1))
    assert not any("the same in all cells" in note for note in notes(8))


@pytest.mark.parametrize(
    ("kind", "meaning", "text", "allowed"),
    [
        (domain, "patch [mm]", "0,1e-150,0,1", "y0 < y1 [mm], of size 1e-50 to 1e+50"),
        (series, "first:last:n[:log] or a,b,c [N]", "1:2:1", "or numbers a,b,c [N]"),
    ],
)
def test_what_is_allowed_is_the_reason(kind, meaning, text, allowed):
    with pytest.raises(InputError) as refused:
        OptionReader([Option("it", kind, None, meaning)], {"it": text})["it"]
    assert str(refused.value).endswith(allowed)


@pytest.mark.parametrize(
    ("method", "name"),
    [
        (None, "ksp_rtol"),
        (None, "pc_circulant_extend"),
        (None, "pc_python_type"),
        ("norm", "ksp_norm_type"),
        ("fmg_v11", "mg_levels_ksp_max_it"),
        ("fmg_v11", "mg_levels_pc_sor_omega"),
        ("primal", "pc_two_grid_sweeps"),
        ({"tao.opts": {"lcp_type": "tao", "tao_type": "tron"}}, "tao_type"),
    ],
)
def test_of_misspelt_solver_options_the_nearest_is_told_every_time(method, name, capfd):
    problem = ContactProblem(GRID, STEEL, HEIGHTS, periodic=method == "primal")
    for misspelt in (f"{name}{name[-1]}", f"{name[:-2]}{name[-1]}{name[-2]}"):
        with pytest.raises(InputError) as refused:
            ContactSolver(problem, method=method, options={misspelt: 1})
        assert str(refused.value) == f"unknown or unused option: -{misspelt} (did you mean -{name}?)"
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("name", ["bogus", "pc_two_grid_sweeps", "ksp_gmres_restart", "mg_levels_ksp_rtol"])
def test_options_of_other_solvers_are_not_taken_for_misspelt(name):
    with pytest.raises(InputError) as refused:
        ContactSolver(BALL, options={name: 1})
    assert str(refused.value) == f"unknown or unused option: -{name}"


@pytest.mark.parametrize("number", [lambda x, y: x if x > y else y, lambda x, y: math.hypot(x, y)])
def test_a_gap_of_numbers_is_told_how_to_take_arrays(number):
    with pytest.raises((TypeError, ValueError), match=r"arrays x, y; np.vectorize\(f\)"):
        ContactProblem(GRID, STEEL, number).shape_on(GRID)
    assert ContactProblem(GRID, STEEL, np.vectorize(number)).shape_on(GRID).shape == GRID.shape


def test_numbers_of_the_file_have_its_names_in_a_solution():
    found = solve(BALL, load=5)
    assert (found.reason, found.lcp_rtol) == (found.message, found.rtol)
    assert found.contact_modulus == found.attributes["contact_modulus"]
    assert {"reason", "contact_modulus"} <= set(dir(found))
    with pytest.raises(AttributeError, match="has no max_pressur; did you mean max_pressure?"):
        _ = found.max_pressur
    with pytest.raises(AttributeError, match="this solution has no nothing; what it has: .attributes"):
        _ = found.nothing


@pytest.mark.parametrize("name", [None, 3, "folder.h5/"])
def test_a_result_needs_the_name_of_a_file(name, tmp_path):
    with pytest.raises(InputError, match="result file"):
        solve(BALL, load=5).save(f"{tmp_path}/{name}" if isinstance(name, str) else name)


class _Asking:
    def __init__(self, omega):
        self.omega = omega

    def apply(self, pc, x, y):
        x.copy(y)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (3, "is int; must be a class"),
        (object, r"has no method apply\(pc, x, y\)"),
        (_Asking, "PETSc makes it without arguments: missing a required argument: 'omega'"),
    ],
)
def test_preconditioner_that_petsc_cannot_make(part, message, monkeypatch):
    """It would end the process."""
    monkeypatch.setitem(sys.modules, "own_parts", SimpleNamespace(Part=part))
    with pytest.raises(InputError, match=f"-pc_python_type own_parts.Part: {message}"):
        ContactSolver(BALL, options={"pc_python_type": "own_parts.Part"})


def test_module_of_a_preconditioner_that_does_not_load(tmp_path, monkeypatch):
    (tmp_path / "unfinished_parts.py").write_text("class Part(:\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="-pc_python_type unfinished_parts.Part: SyntaxError: "):
        ContactSolver(BALL, options={"pc_python_type": "unfinished_parts.Part"})
