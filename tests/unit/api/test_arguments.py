"""Arguments of the solver that are refused."""

import sys
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from cases import hertz

from app import (
    ContactProblem,
    ContactSolver,
    Grid,
    Listener,
    Material,
    Paraboloid,
    Sphere,
    read_surface,
    refine,
    solve,
)
from app.base.errors import InputError
from app.problems.problem import Problem

STEEL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
HEIGHTS = np.random.default_rng(3).random(GRID.shape) * 1e-3
BALL = ContactProblem(GRID, STEEL, Sphere(10))


def test_arguments_are_not_modified():
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
def test_a_preconditioner_class_that_petsc_cannot_make_is_refused(part, message, monkeypatch):
    """It would end the process."""
    monkeypatch.setitem(sys.modules, "own_parts", SimpleNamespace(Part=part))
    with pytest.raises(InputError, match=f"-pc_python_type own_parts.Part: {message}"):
        ContactSolver(BALL, options={"pc_python_type": "own_parts.Part"})


def test_a_module_of_a_preconditioner_with_errors_is_refused(tmp_path, monkeypatch):
    (tmp_path / "unfinished_parts.py").write_text("class Part(:\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="-pc_python_type unfinished_parts.Part: SyntaxError: "):
        ContactSolver(BALL, options={"pc_python_type": "unfinished_parts.Part"})


@pytest.mark.parametrize("listeners", [[print], [Listener], [None], Listener(), 3])
def test_wrong_listeners_are_refused_before_any_work(listeners):
    with (
        mock.patch("app.api.solver.Hierarchy", side_effect=AssertionError),
        pytest.raises(InputError, match="^listeners: is .*; must be .*app.Listener$"),
    ):
        ContactSolver(hertz(12), listeners=listeners)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("unused option: -", lambda: ContactSolver(BALL, options={"": 2})),
        ("-ksp_view x: must be nothing, or ascii", lambda: ContactSolver(BALL, options={"ksp_view": "x"})),
        ("is a folder", lambda: ContactSolver(BALL, options={"ksp_view": ":.:ascii_info"})),
        ("no folder", lambda: ContactSolver(BALL, options={"ksp_converged_reason": ":nowhere/a"})),
        ("a ContactProblem", lambda: ContactSolver(HEIGHTS)),
        ("a mapping", lambda: ContactSolver(BALL, options=["lcp_rtol"])),
        ("names of options", lambda: ContactSolver(BALL, options={3: 8})),
        ("-lcp_rtol: must be names without", lambda: ContactSolver(BALL, options={"-lcp_rtol": 1e-8})),
        ("method file", lambda: ContactSolver(BALL, method=3)),
        ("'own': is int; .*mapping", lambda: ContactSolver(BALL, method={"own": 3})),
        ("communicator", lambda: ContactSolver(BALL, comm=3)),
        ("list of 3; must be .*ContactSolver.path", lambda: solve(BALL, load=[1, 2, 3])),
        ("load: is MaskedConstant; must be a number", lambda: solve(BALL, load=np.ma.masked)),
        ("approach 'deep': must be a number \\[mm\\]", lambda: solve(BALL, approach="deep")),
        ("approach: is bool; must", lambda: solve(BALL, approach=True)),
        ("load inf: must be a number of size", lambda: solve(BALL, load=10**400)),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("true", [True, np.True_])
@pytest.mark.parametrize(
    "use",
    [
        lambda true: ContactProblem(GRID, STEEL, Paraboloid(9, 9), hardness=true),
        lambda true: ContactProblem(GRID, STEEL, Paraboloid(9, true)),
        lambda true: ContactProblem(GRID, STEEL, np.full(GRID.shape, true)),
        lambda true: Paraboloid.between(true, 9),
        lambda true: Grid.from_domain(8, 8, (0, true, 0, 1)),
        lambda true: Grid(8, 8, true, 1.0),
        lambda true: Material.isotropic(true, 0.3),
        lambda true: Material.pair((true, 1e5), (0.3, 0.3)),
        lambda true: Material.coated((true, 1e5), (0.3, 0.3), 1.0),
        lambda true: STEEL.conducting(resistivity=true),
        lambda true: read_surface(HEIGHTS, "um", spacing=true),
        lambda true: read_surface(HEIGHTS, "um", spacing=(0.1, 0.1), s_filter=true),
        lambda true: solve(BALL, load=true),
        lambda true: refine(BALL, load=1.0, until=true),
    ],
)
def test_true_is_no_number(use, true):
    with pytest.raises(InputError, match="must be") as refused:
        use(true)
    assert "\n" not in str(refused.value)
