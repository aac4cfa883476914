"""A prescribed contact area: a loading of one's own, in all interfaces and with all methods of its patches."""

import re

import numpy as np
import pytest
from processes import run
from recorded import RUBBER, STEEL, ball, forced_safeguard, rough

from app import (
    ContactProblem,
    ContactSolver,
    FlatPunch,
    Grid,
    InputError,
    Material,
    refine,
    solve,
    solve_many,
)

COMMAND = "contact_area.py -problem sphere -sphere_radius 10 -contact_modulus 1e5 -domain -1,1,-1,1 -grid 32".split()


@pytest.fixture(autouse=True)
def contact_area(example):
    return example("contact_area").PrescribedContactArea


CASES = {
    "free": (rough(64), None),
    "periodic in x": (rough(64, periodic="x"), None),
    "plastic": (rough(64, hardness=8e3), None),
    "film": (ball(64, RUBBER), None),
    "paper's": (rough(64), "fmg_v11"),
    "paper's, plastic": (ball(64, hardness=2e3), "fmg_v11"),
}


@pytest.mark.parametrize("share", [0.05, 0.5])
@pytest.mark.parametrize("name", CASES)
def test_area_and_load_determine_each_other(name, share, contact_area):
    problem, method = CASES[name]
    area = share * problem.grid.area
    by_area = solve(problem, method=method, contact_area=area)
    assert by_area.converged and by_area.prescribed == "contact_area"
    assert by_area.contact_area == pytest.approx(area, rel=contact_area.result_rtol)
    by_load = solve(problem, method=method, load=by_area.load)
    assert by_load.approach == pytest.approx(by_area.approach, rel=1e-4, abs=1e-6)
    assert np.count_nonzero(by_load.contact != by_area.contact) <= 4


def test_safeguard_finds_the_same_area():
    with forced_safeguard():
        safe = solve(rough(32), contact_area=0.3)
    assert safe.converged and safe.fallbacks
    assert safe.load == pytest.approx(solve(rough(32), contact_area=0.3).load, rel=1e-2)


def test_start_changes_the_work_only():
    with ContactSolver(rough(64)) as solver:
        start = solver.solve(contact_area=0.3)
        again = solver.solve(contact_area=0.32, start=start)
        assert again.load == pytest.approx(solver.solve(contact_area=0.32).load, rel=1e-2)


def test_path_continues_after_finished_steps():
    with ContactSolver(rough(32)) as solver:
        path = solver.path(contact_area=[0.1, 0.2, 0.3])
        assert all(solution.converged for solution in path)
        assert path.table["contact_area"] == pytest.approx([0.1, 0.2, 0.3], rel=0.02)
        assert len(list(solver.path(contact_area=[0.1, 0.2, 0.3], rows=path.rows[:2]))) == 1
        with pytest.raises(InputError, match="step 2 has contact_area"):
            solver.path(contact_area=[0.1, 0.4, 0.5], rows=path.rows[:2])


def test_refinement_converges_to_hertz():
    found = refine(ball(32), 0.02, contact_area=0.2)
    a, modulus, radius = (0.2 / np.pi) ** 0.5, STEEL.contact_modulus, 10.0
    assert found.reached
    assert found.solution.load == pytest.approx(4 / 3 * modulus * a**3 / radius, rel=0.03)


def test_processes_import_the_loading():
    problems, areas = [ball(32), ball(64)], [0.1, 0.2]
    table = solve_many(problems, contact_area=areas, processes=2)
    assert table.converged
    alone = [solve(problem, contact_area=area).load for problem, area in zip(problems, areas, strict=True)]
    assert table["load"] == pytest.approx(alone, rel=1e-9)


def test_area_under_a_background_pressure_and_over_time():
    gas = ball(32, background_pressure=20.0)
    solution = solve(gas, contact_area=0.2)
    assert solution.converged and solve(gas, load=solution.load).contact_area == solution.contact_area
    rubber = Material.pair((10, np.inf), (0.5, 0.3)).viscoelastic(times=(0.1, 10), moduli=(0.3, 0.4))
    with ContactSolver(ball(32, rubber)) as solver:
        loads = [step.load for step in solver.creep([0, 1e6], contact_area=0.2)]
    assert loads[1] == pytest.approx(0.3 * loads[0], rel=0.05)  # at the same contact, by the relaxed modulus


@pytest.mark.ranks(2)
def test_command_solves_a_load_path(ranks, folder):
    done = run(*COMMAND, "-contact_area_path", "0.3:0.6:2", ranks=ranks, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert len(re.findall(r"step . of 2: contact area 0\.", done.stdout)) == 2


@pytest.mark.parametrize(
    ("problem", "loading", "message"),
    [
        (ball(16, periodic=True), {"contact_area": 0.2}, "contact_area: not on a patch periodic in x and y"),
        (ball(16), {"contact_area": 1.0}, "contact_area 1: must be from 0.00390625 mm2, a cell"),
        (ball(16), {"contact_area": -1.0}, "contact_area -1: must be"),
        (ball(16), {"contact_area": 0.1, "load": 1.0}, r"exactly one of .* and contact_area \[mm2\]"),
    ],
)
def test_areas_that_are_not_possible_are_refused(problem, loading, message):
    with pytest.raises(InputError, match=message):
        solve(problem, **loading)
    if problem.grid.periodic:
        with pytest.raises(InputError, match=message):
            solve_many([problem], **loading)


def test_area_that_no_approach_has_is_not_converged():
    flat = ContactProblem(Grid.from_domain(32, 32, (-0.5, 0.5, -0.5, 0.5)), STEEL, FlatPunch(0.5))
    with pytest.warns(RuntimeWarning, match="no approach has this contact_area"):
        assert not solve(flat, contact_area=0.1).converged


def test_array_has_no_sensitivity_at_a_fixed_area():
    with ContactSolver(ball(32)) as solver:
        solution = solver.solve(contact_area=0.2)
        assert np.isfinite(solver.sensitivity(solution, "load")).all()
        with pytest.raises(InputError, match="not at a prescribed contact_area"):
            solver.sensitivity(solution, np.ones((32, 32)))
