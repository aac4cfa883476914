"""Methods from options: what overrides what, and what is refused."""

import gc
import re
import warnings

import numpy as np
import pytest
import running
from cases import APPROACH, hertz, periodic_rough, punch

from app import ContactProblem, ContactSolver, Grid, Material, Sphere, solve
from app.base.errors import InputError
from app.options.method import METHOD_OPTIONS, read_method_file

from ..api.solvers import communicators

SNESVI = {"snesvi": {"lcp_type": "snesvi"}}
PLAIN_CG = {"cg": {"ksp_type": "cg", "pc_type": "none"}}
OPTIONS = {
    "unknown method": ({"method": "faster"}, "method 'faster': must be one of .*fmg_v11"),
    "a problem is no method": ({"method": "hertz"}, "problem|hertz"),
    "unknown option": ({"options": {"lcp_foo": 1}}, "lcp_foo"),
    "value that is no number": ({"options": {"lcp_rtol": "small"}}, "-lcp_rtol small"),
    "unknown PC": ({"options": {"pc_type": "gc"}}, "gc"),
    "unknown smoother": ({"method": "fmg_v11", "options": {"mg_levels_pc_type": "gc"}}, "gc"),
    "unknown line search": ({"options": {"lcp_type": "snesvi", "snes_linesearch_type": "gc"}}, "gc"),
    "linear solver that needs entries": ({"method": "norm", "options": {"pc_type": "gamg"}}, "No method"),
    "only the default method": ({"method": "norm", "options": {"lcp_predictor": 1.0}}, "lcp_predictor.*no effect"),
    "only nested": ({"method": "mg_v11", "options": {"lcp_beta": 0.01}}, "lcp_beta.*no effect"),
    "only by copy": ({"options": {"lcp_beta": 0.01}}, "lcp_beta.*no effect"),
    "only active sets": ({"options": {"lcp_type": "snesvi", "lcp_nested": True}}, "lcp_nested.*no effect"),
    "windows without nested": ({"options": {"lcp_nested": False, "lcp_window": 0.1}}, "lcp_window.*no effect"),
    "windows of active sets": ({"options": {"ksp_type": "cg", "lcp_window": 0.1}}, "lcp_window.*no effect"),
    "smoother without effect": (
        {"method": "fmg_v11", "options": {"mg_levels_pc_type": "jacobi", "mg_levels_pc_sor_omega": 0.3}}, "omega"
    ),
    "smoother without bounds": (
        {"method": "fmg_v11", "options": {"mg_levels_ksp_type": "chebyshev"}}, "mg_levels_ksp_chebyshev_eigenvalues"
    ),
    "mistake in a file that is overridden": (
        {"method": {"m": {"pc_type": "mg", "pc_mg_tipe": "full"}}, "options": {"pc_type": "none"}}, "tipe$"
    ),
    "idle in its own file": ({"method": {"m": {"ksp_type": "cg", "lcp_beta": "1"}}}, "lcp_beta 1: has no effect"),
    "multigrid by type": ({"options": {"lcp_type": "snesvi", "pc_type": "mg"}}, "-pc_type mg: works on contact sets"),
    "multigrid of SNESVI": (
        {"options": {"lcp_type": "snesvi", "pc_python_type": "app.multigrid.ContactMG"}}, "works on contact sets"
    ),
    "no tracking": ({"method": "fast", "options": {"ksp_type": "cg"}}, "TrackingCG|ksp_python_type"),
}  # fmt: skip
REFUSED = [  # methods, an option, and a part of the message
    ([None], "ksp_error_if_not_converged", "allowed with -lcp_type active_set or snesvi$"),
    ([None], "ksp_diagonal_scale", r"what is written in Python has no method diagonalScale\(\)$"),
    ([SNESVI], "ksp_guess_type", "allowed with -lcp_type active_set$"),
    ([None, "norm", SNESVI], "ksp_view_diagonal_scale", "^-ksp_view_diagonal_scale: "),
    (
        [None, "norm", "mg_v11", SNESVI],
        "ksp_monitor_error",
        "needs a PETSc DM, and the program has none$",
    ),
    (
        [{"a": PLAIN_CG["cg"], "b": {"ksp_bogus": ""}}, "fmg_v11"],
        "ksp_bogus",
        "^unknown or unused option: -ksp_bogus$",
    ),
]
OPTIONS |= {
    f"{name} {k}": ({"method": method, "options": {name: "pod" if "guess" in name else ""}}, message)
    for methods, name, message in REFUSED
    for k, method in enumerate(methods)
}
OPTIONS |= {
    f"mistake in a file {k}": (
        {"method": {"a": PLAIN_CG["cg"] | {"ksp_bogus": ""}}, "options": options},
        "ksp_bogus$",
    )
    for k, options in enumerate(({}, {"ksp_rtol": 0.1}))
}
OVERRIDDEN = {  # method, and options that leave much of it without a reader
    "multigrid": ("fmg_v11", {"pc_type": "none", "ksp_type": "cg", "ksp_max_it": 30}),
    "preconditioner": ("fast", {"pc_type": "none"}),
    "nested": ("fast", {"lcp_nested": False}),
    "smoother": (
        "fmg_v11",
        {
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_pc_type": "jacobi",
            "mg_levels_ksp_max_it": 2,
            "mg_levels_ksp_chebyshev_eigenvalues": "0.5,30",
        },
    ),
    "strategy": ("fast", {"lcp_type": "snesvi"}),
    "strategy, by a file": ({"a": read_method_file("fmg_v11"), "b": read_method_file("norm")}, {}),
    "method, by a file": ({"a": read_method_file("fast"), "b": read_method_file("fmg_v11")}, {"lcp_rtol": 1e-7}),
}  # fmt: skip


@pytest.mark.parametrize("case", OVERRIDDEN)
def test_options_override_a_method_file(case):
    method, options = OVERRIDDEN[case]
    found = running.solve(hertz(24), APPROACH, method, **options)
    assert found.converged
    assert found.load == pytest.approx(solve(hertz(24), approach=APPROACH).load, rel=1e-4)
    gone = [note for note in found.notes if "gives way to" in note]
    assert len(gone) == ("strategy" in case or "by a file" in case)
    useless = [note for note in found.notes if "without effect" in note]
    assert len(useless) == (not gone) and all(note.startswith(f"{method}: ") for note in useless)


@pytest.mark.parametrize("kind", ["active_set", "fast", "snesvi"])
def test_an_option_at_its_default_is_never_refused(kind):
    defaults = {option.name: option.default for option in METHOD_OPTIONS} | {"lcp_type": kind}
    with ContactSolver(hertz(8), options=defaults) as solver:
        assert solver.settings.type == kind


def test_the_last_method_file_counts():
    files = {name: read_method_file(name) for name in ("fast", "fmg_v11")}
    alone = running.solve(hertz(24), APPROACH, "fmg_v11")
    assert running.solve(hertz(24), APPROACH, files).history["residual"] == alone.history["residual"]


@pytest.mark.parametrize("case", OPTIONS)
def test_an_invalid_option_is_refused_and_leaves_no_communicator(case):
    arguments, message = OPTIONS[case]
    numbers = []
    for _ in range(2):  # PETSc may make some once
        with pytest.raises(InputError, match=message):
            ContactSolver(punch(24), **arguments)
        gc.collect()
        numbers.append(communicators())
    assert numbers[0] == numbers[1]


STEEL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
HEIGHTS = np.random.default_rng(3).random(GRID.shape) * 1e-3
BALL = ContactProblem(GRID, STEEL, Sphere(10))


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
        ({"vi.opts": {"lcp_type": "snesvi", "snes_stol": "0"}}, "snes_stol"),
    ],
)
def test_a_similar_name_is_suggested_for_a_misspelt_option(method, name, capfd):
    problem = ContactProblem(GRID, STEEL, HEIGHTS, periodic=method == "primal")
    for misspelt in (f"{name}{name[-1]}", f"{name[:-2]}{name[-1]}{name[-2]}"):
        with pytest.raises(InputError) as refused:
            ContactSolver(problem, method=method, options={misspelt: 1})
        assert str(refused.value) == f"unknown or unused option: -{misspelt} (did you mean -{name}?)"
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("name", ["bogus", "pc_two_grid_sweeps", "ksp_gmres_restart", "mg_levels_ksp_rtol"])
def test_an_option_of_another_solver_gets_no_suggestion(name):
    with pytest.raises(InputError) as refused:
        ContactSolver(BALL, options={name: 1})
    assert str(refused.value) == f"unknown or unused option: -{name}"


PROBLEM = hertz(16)
REFERENCE = "snes_converged_reason snes_view"
NONSENSE = f"pc_view pc_view_nonsense mat_viewfoo mat_view_nonsense snes_view_zzz {REFERENCE}"
READ = [
    (None, "ksp_converged_reason"),
    ("norm", "ksp_converged_reason"),
    (PLAIN_CG, "ksp_converged_reason"),
    ("fmg_v11", "ksp_converged_reason mg_levels_ksp_converged_reason mg_levels_1_ksp_converged_reason"),
    ("fmg_v11", "mg_coarse_ksp_converged_reason mg_coarse_sub_ksp_converged_reason"),
    ("fmg_v11", "mg_coarse_mat_view mg_coarse_sub_mat_view"),
    (SNESVI, "ksp_converged_reason snes_converged_reason snes_view snes_view_pre snes_view_solution"),
    (SNESVI, "snes_test_jacobian"),
]  # fmt: skip
UNREAD = [
    (None, f"{NONSENSE} foo_ksp_converged_reason mat_view"),
    ("norm", "snes_view mat_view"),
    ("fmg_v11", f"{NONSENSE} mg_levels_pc_view_q mg_levels_9_ksp_converged_reason mg_levels_mat_view"),
    (SNESVI, "snes_view_zzz mat_view_zzz"),
]
PYTHON_KSP = {"ksp_monitor_solution": "", "ksp_guess_type": "fischer", "ksp_knoll": ""}


def each(table):
    return [(method, name) for method, names in table for name in names.split()]


@pytest.mark.parametrize(("method", "name"), each(READ))
def test_an_accepted_option_is_used_by_the_end_of_a_solve(method, name, capfd):
    with ContactSolver(PROBLEM, method, {name: ""}) as solver:
        found = solver.solve(approach=0.1)
        assert found.converged and "unused" not in " ".join(found.notes)
        assert name in solver.options.used
        assert name in solver.settings.texts
    assert capfd.readouterr().out


@pytest.mark.parametrize(("method", "name"), each(UNREAD))
def test_an_unused_option_is_refused_or_noted_after_the_first_solve(method, name):
    """In a note if its name is like one that PETSc reads while it solves; a solve without contact reads none."""
    try:
        solver = ContactSolver(PROBLEM, method, {name: ""})
    except InputError as error:
        assert re.match(rf"unknown or unused option: -{name}\b", str(error))
        return
    with solver:
        away, *found = (solver.solve(approach=approach) for approach in (-0.1, 0.1, 0.1))
    assert not any("unused" in note for note in away.notes)
    unused = [
        [note for note in solution.notes if note.startswith(f"unused option: -{name}")] for solution in found
    ]
    assert [len(notes) for notes in unused] == [1, 0]


@pytest.mark.parametrize("problem", [PROBLEM, periodic_rough(32)])
@pytest.mark.parametrize("name", PYTHON_KSP)
def test_options_that_need_a_solution_of_the_ksp_are_refused_by_default_methods(problem, name):
    with pytest.raises(InputError, match=rf"^-{name}: .*; allowed with -lcp_type active_set( or snesvi)?$"):
        ContactSolver(problem, options={name: PYTHON_KSP[name]})


def test_an_option_that_is_off_is_not_refused():
    ContactSolver(PROBLEM, options={"ksp_knoll": False, "ksp_error_if_not_converged": "no"}).close()


@pytest.mark.parametrize("method", ["norm", "mg_v11", SNESVI])
def test_an_unconverged_linear_solve_is_the_reason_if_asked_for(method):
    options = {"ksp_max_it": 2, "ksp_error_if_not_converged": "", "ksp_rtol": 1e-12}
    if method in ("norm", "mg_v11"):
        options |= {"ksp_type": "cg", "ksp_norm_type": "unpreconditioned", "ksp_atol": 0}
    with warnings.catch_warnings(), ContactSolver(PROBLEM, method, options) as solver:
        warnings.simplefilter("ignore", RuntimeWarning)
        for _ in range(2):
            found = solver.solve(approach=0.1)
            assert found.message
            if method == "norm":
                assert not found.converged and "DIVERGED_" in found.message


WITHOUT_GUESS = (
    r"(Running )?KSP of .*preonly.* doesn't make sense with nonzero initial guess you probably want"
)
FAILS_LATE = [
    ("fmg_v11", "mg_coarse_sub_ksp_initial_guess_nonzero", "", WITHOUT_GUESS),
    ("mg_v11", "mg_levels_ksp_type", "preonly", WITHOUT_GUESS),
    (SNESVI, "pc_type", "lu", "Could not locate a solver type for factorization type LU"),
]


@pytest.mark.parametrize(("method", "name", "value", "told"), FAILS_LATE)
def test_options_that_fail_in_a_solve_are_refused_each_time(method, name, value, told):
    with ContactSolver(PROBLEM, method, {name: value}) as solver:
        for _ in range(2):
            with pytest.raises(InputError, match=f"^solver options: {told}[^\n]*$"):
                solver.solve(approach=0.1)


def test_strategy_of_free_patches_is_refused_on_periodic_ones():
    with pytest.raises(InputError, match="-lcp_type fast: .* must be primal, active_set or snesvi"):
        ContactSolver(periodic_rough(32), options={"lcp_type": "fast"})
