"""PETSc's options: who reads them, and those that a method cannot do."""

import re
import warnings

import pytest
from cases import hertz, periodic_rough

from app import ContactProblem, ContactSolver, Grid
from app.base.errors import InputError

PROBLEM = hertz(16)
SNESVI, TAO = {"snesvi": {"lcp_type": "snesvi"}}, {"tao": {"lcp_type": "tao"}}
PLAIN_CG = {"cg": {"ksp_type": "cg", "pc_type": "none"}}
REFERENCE = "snes_converged_reason snes_view tao_converged_reason tao_view"
NONSENSE = f"pc_view pc_view_nonsense mat_viewfoo mat_view_nonsense snes_view_zzz tao_view_zzz {REFERENCE}"
READ = [
    (None, "ksp_converged_reason"),
    ("norm", "ksp_converged_reason"),
    (PLAIN_CG, "ksp_converged_reason"),
    ("fmg_v11", "ksp_converged_reason mg_levels_ksp_converged_reason mg_levels_1_ksp_converged_reason"),
    ("fmg_v11", "mg_coarse_ksp_converged_reason mg_coarse_sub_ksp_converged_reason"),
    ("fmg_v11", "mg_coarse_mat_view mg_coarse_sub_mat_view"),
    (SNESVI, "ksp_converged_reason snes_converged_reason snes_view snes_view_pre snes_view_solution"),
    (SNESVI, "snes_test_jacobian"),
    (TAO, "ksp_converged_reason tao_converged_reason tao_view tao_ls_view tao_test_gradient tao_test_hessian"),
]  # fmt: skip
UNREAD = [
    (None, f"{NONSENSE} foo_ksp_converged_reason mat_view"),
    ("norm", "snes_view tao_view mat_view"),
    ("fmg_v11", f"{NONSENSE} mg_levels_pc_view_q mg_levels_9_ksp_converged_reason mg_levels_mat_view"),
    (SNESVI, "snes_view_zzz tao_view tao_converged_reason"),
    (TAO, "tao_view_zzz snes_view snes_converged_reason"),
]
PYTHON_KSP = {"ksp_monitor_solution": "", "ksp_guess_type": "fischer", "ksp_knoll": ""}


def each(table):
    return [(method, name) for method, names in table for name in names.split()]


@pytest.mark.parametrize(("method", "name"), each(READ))
def test_what_is_accepted_is_read_by_the_end_of_a_solve(method, name, capfd):
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
def test_the_linear_solvers_of_default_methods_have_no_solution_of_their_own(problem, name):
    with pytest.raises(
        InputError, match=rf"^-{name}: .*; allowed with -lcp_type active_set( or tao or snesvi)?$"
    ):
        ContactSolver(problem, options={name: PYTHON_KSP[name]})


@pytest.mark.parametrize("name", PYTHON_KSP)
@pytest.mark.parametrize("method", ["norm", "mg_v11"])
def test_other_methods_solve_as_ever_with_them(method, name, capfd):
    with (
        ContactSolver(PROBLEM, method, {name: PYTHON_KSP[name]}) as changed,
        ContactSolver(PROBLEM, method) as plain,
    ):
        assert changed.solve(approach=0.1).load == pytest.approx(plain.solve(approach=0.1).load, rel=1e-6)


def test_what_is_switched_off_is_not_refused():
    ContactSolver(PROBLEM, options={"ksp_knoll": False, "ksp_error_if_not_converged": "no"}).close()


def test_the_default_methods_end_linear_solves_early():
    with pytest.raises(
        InputError, match=r"^-ksp_error_if_not_converged: .* with -lcp_type active_set or tao or snesvi$"
    ):
        ContactSolver(PROBLEM, options={"ksp_error_if_not_converged": ""})


@pytest.mark.parametrize("method", ["norm", "mg_v11", SNESVI, TAO])
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


def test_norm_solves_as_ever_if_every_linear_solve_must_converge():
    with ContactSolver(PROBLEM, "norm", {"ksp_error_if_not_converged": ""}) as solver:
        assert solver.solve(approach=0.1).converged


NOT_SHOWN = ["::ascii_info_detail", "::ascii_xml", "binary:x", "hdf5:x"]
NOT_DRAWN = [f"ksp_monitor_{name}" for name in ("short", "range", "max", "singular_value")]


@pytest.mark.parametrize("method", [None, "norm", "mg_v11"])
@pytest.mark.parametrize(
    "name", ["ksp_monitor", "ksp_monitor_true_residual", *NOT_DRAWN, "mg_levels_ksp_monitor"]
)
def test_monitors_that_crash_petsc_are_refused(method, name):
    for view in NOT_SHOWN + ["draw"] * (name in NOT_DRAWN):
        with pytest.raises(InputError, match=f"^-{name} {view}: "):
            ContactSolver(PROBLEM, method, {name: view})


def test_a_reason_with_a_format_that_crashes_petsc_is_refused():
    with pytest.raises(InputError, match="^-snes_converged_reason ::ascii_info_detail: "):
        ContactSolver(PROBLEM, SNESVI, {"snes_converged_reason": "::ascii_info_detail"})


def test_monitors_may_write_text_to_a_file(tmp_path):
    for view in (f":{tmp_path / 'Text'}", f"ascii:{tmp_path / 'Text'}:default"):
        with ContactSolver(PROBLEM, "norm", {"ksp_monitor": view}) as solver:
            solver.solve(approach=0.1)
        assert "KSP Residual norm" in (tmp_path / "Text").read_text()


@pytest.mark.parametrize("method", [SNESVI, TAO])
def test_systems_of_another_size_take_no_guess(method):
    with pytest.raises(InputError, match=r"^-ksp_guess_type: .*; allowed with -lcp_type active_set$"):
        ContactSolver(PROBLEM, method, {"ksp_guess_type": "pod"})


WITHOUT_GUESS = (
    r"(Running )?KSP of .*preonly.* doesn't make sense with nonzero initial guess you probably want"
)
FAILS_LATE = [
    ("fmg_v11", "mg_coarse_sub_ksp_initial_guess_nonzero", "", WITHOUT_GUESS),
    ("mg_v11", "mg_levels_ksp_type", "preonly", WITHOUT_GUESS),
    (TAO, "pc_type", "lu", "Could not locate a solver type for factorization type LU"),
]


@pytest.mark.parametrize(("method", "name", "value", "told"), FAILS_LATE)
def test_what_fails_in_a_solve_is_refused_in_a_line_each_time(method, name, value, told):
    with ContactSolver(PROBLEM, method, {name: value}) as solver:
        for _ in range(2):
            with pytest.raises(InputError, match=f"^solver options: {told}[^\n]*$"):
                solver.solve(approach=0.1)


CRASHES = [(TAO, "ksp_converged_rate")]
CRASHES += [(method, "ksp_view_diagonal_scale") for method in (None, "norm", SNESVI, TAO)]


@pytest.mark.parametrize(("method", "name"), CRASHES)
def test_what_petsc_crashes_with_is_refused(method, name):
    with pytest.raises(InputError, match=f"^-{name}: "):
        ContactSolver(PROBLEM, method, {name: ""})


@pytest.mark.parametrize(
    ("method", "options"),
    [
        (SNESVI, {"ksp_converged_rate": ""}),
        (SNESVI, {"ksp_diagonal_scale": "", "ksp_view_diagonal_scale": ""}),
    ],
)
def test_what_others_can_do_is_not(method, options, capfd):
    with ContactSolver(PROBLEM, method, options) as solver:
        assert solver.solve(approach=0.1).converged
    assert capfd.readouterr().out


def test_a_method_that_is_missing_in_python_is_said_to_be():
    with pytest.raises(InputError, match=r"what is written in Python has no method diagonalScale\(\)$"):
        ContactSolver(PROBLEM, options={"ksp_diagonal_scale": ""})


@pytest.mark.parametrize("method", [None, "norm", "mg_v11", SNESVI, TAO])
def test_monitors_of_errors_need_what_there_is_not(method):
    with pytest.raises(InputError, match=r"^-ksp_monitor_error: needs a DM of PETSc's, there is none$"):
        ContactSolver(PROBLEM, method, {"ksp_monitor_error": ""})


@pytest.mark.parametrize("length", [1e-12, 1e-16])
@pytest.mark.parametrize("kind", ["tron", "blmvm", "gpcg", "bnls", "bncg", "bqnls"])
def test_tao_gives_up_with_a_reason_at_tiny_lengths(kind, length):
    grid = Grid.from_domain(16, 16, (-10 * length, 10 * length, -6 * length, 6 * length))
    problem = ContactProblem(grid, PROBLEM.material, lambda x, y: (x**2 / 600 + y**2 / 326) / length)
    with (
        warnings.catch_warnings(),
        ContactSolver(problem, options={"lcp_type": "tao", "tao_type": kind}) as solver,
    ):
        warnings.simplefilter("ignore", RuntimeWarning)
        for _ in range(2):
            found = solver.solve(approach=0.1 * length)
            assert found.converged or found.error_bound > 0.01 or "TAO" in found.message
