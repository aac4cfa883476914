"""What a program may hand over by mistake is refused in a line, or does what it says; nothing of it is overlooked."""

import math

import numpy as np
import pytest

from app import (
    ContactProblem,
    ContactSolver,
    Grid,
    Material,
    Sphere,
    read_result,
    refine,
    solve,
)
from app.base.errors import InputError
from app.cli.subsurface import stress
from app.halfspace.stress.subsurface import SubsurfaceStress

STEEL = Material.from_contact_modulus(1e5)

GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))

HEIGHTS = np.random.default_rng(3).random(GRID.shape) * 1e-3

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


@pytest.mark.parametrize("number", [lambda x, y: x if x > y else y, lambda x, y: math.hypot(x, y)])
def test_a_gap_of_numbers_is_told_how_to_take_arrays(number):
    with pytest.raises((TypeError, ValueError), match=r"arrays x, y; np.vectorize\(f\)"):
        ContactProblem(GRID, STEEL, number).shape_on(GRID)
    assert ContactProblem(GRID, STEEL, np.vectorize(number)).shape_on(GRID).shape == GRID.shape
