"""The errors that the size of the cells makes, from two grids; refining until they are small."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough, self_affine
from running import solve

import app
from app import ContactProblem, FlatPunch, Grid, Material, Roller, SelfAffineSurface, Sphere, refine
from app.api import refinement
from app.api.summary import refinement_table
from app.base.errors import InputError

PAIRS = {"load": "load_error", "max_pressure": "max_pressure_error", "contact_area": "contact_area_error"}


@pytest.mark.parametrize("n", [32, 48, 64, 96, 128, 256])
def test_estimated_errors_bound_the_errors_on_hertz(n):
    solution, known = solve(hertz(n), APPROACH, None), hertz(n).reference(APPROACH)
    for name, estimate in PAIRS.items():
        error = abs(getattr(solution, name) / getattr(known, name) - 1)
        estimated = getattr(solution, estimate)
        assert error < estimated < 60 * error + 2 / n, name
    assert solution.approach_error == 0


@pytest.mark.parametrize(("seed", "load", "area"), [(2, 10, 0.007684), (11, 10, 0.008133)])
def test_cells_without_pressure_do_not_count_in_the_area_error(seed, load, area):
    """A rough ball; area of twice and four times as many cells. Coarse grids are left before such cells leave again."""
    surface = SelfAffineSurface(0.8, 0.1, 0.008, (0.4, 0.4), seed=seed, rms_height=1.5e-4)
    grid = Grid.from_domain(512, 512, (-0.13, 0.13, -0.13, 0.13))
    steel = Material.pair((210e3, 210e3), (0.3, 0.3))
    found = app.solve(ContactProblem(grid, steel, Sphere(5), surfaces=[surface]), load=load)
    error = abs(found.contact_area / area - 1)
    assert error < found.contact_area_error < 5 * error


def test_the_load_of_a_punch_converges_its_maximum_pressure_does_not():
    grid = Grid.from_domain(128, 128, (-1.0, 1.0, -1.0, 1.0))
    punch = ContactProblem(grid, Material.combined(8e4, 0.3), FlatPunch(1.0))
    solution = solve(punch, 1e-3, None)
    assert solution.max_pressure_error == 1
    exact = 2 * punch.material.contact_modulus * 0.5 * 1e-3
    assert abs(solution.load / exact - 1) < solution.load_error < 0.2


def test_a_prescribed_load_has_an_approach_error():
    solution = solve(hertz(64), None, None, load=80000.0)
    assert solution.load_error == 0
    assert (
        0
        < abs(solution.approach / solution.attributes["analytic_approach"] - 1)
        < solution.approach_error
        < 0.01
    )


@pytest.mark.parametrize("loading", [{"mean_pressure": 300.0}, {"approach": -1e-3}])
def test_estimated_errors_bound_the_changes_on_a_periodic_rough_surface(loading):
    grids = refine(periodic_rough(64), 1e-9, 128**2, **loading)
    coarse, fine = grids.rows
    for name, estimate in PAIRS.items():
        assert abs(coarse[name] / fine[name] - 1) <= coarse[estimate] + 1e-12, name
    assert abs(coarse["approach"] / fine["approach"] - 1) <= coarse["approach_error"] + 1e-12


@pytest.mark.parametrize("mean_gap", [0.01, 0.005])
@pytest.mark.parametrize("power", [1.0, 1.5])
def test_a_prescribed_mean_gap_has_load_and_approach_errors(power, mean_gap):
    """The mean undeformed distance of a function is another one on every grid."""

    def body(n):
        grid = Grid.from_domain(n, n, (-1.0, 1.0, -1.0, 1.0), periodic=True)
        return ContactProblem(grid, Material.combined(8e4, 0.3), lambda x, y: (x**2 + y**2) ** power / 40)

    best = app.solve(body(256), mean_gap=mean_gap)
    for n in (16, 32, 64):
        solution = app.solve(body(n), mean_gap=mean_gap)
        for name in ("load", "approach", "max_pressure"):
            error = abs(getattr(solution, name) / getattr(best, name) - 1)
            assert 0 < 0.7 * error < getattr(solution, f"{name}_error") < 0.2
    grids = refine(body(16), 0.05, mean_gap=mean_gap)
    assert abs(grids.solution.approach / best.approach - 1) < grids.errors.approach_error < 0.05


def test_without_a_coarser_grid_errors_are_nan():
    for method, options in ((None, {"lcp_nested": False}), ("norm", {})):
        solution = solve(hertz(32), APPROACH, method, **options)
        assert np.isnan([getattr(solution, name) for name in PAIRS.values()]).all()


def test_refinement_stops_when_errors_are_small():
    grids = refine(hertz(16), 0.01, approach=APPROACH)
    assert grids.reached
    assert [row["nx"] for row in grids.rows] == [16 * 2**k for k in range(len(grids.rows))]
    assert not any("refined" in note for note in grids.solution.notes)
    assert grids.errors.largest <= 0.01 < max(grids.rows[-2][name] for name in PAIRS.values())
    known = hertz(16).reference(APPROACH)
    for name in PAIRS:
        assert getattr(grids.solution, name) == pytest.approx(getattr(known, name), rel=0.01)


def test_refinement_stops_at_the_largest_grid():
    grids = refine(hertz(16), 1e-6, 2000, load=80000.0, stiffness=True)
    assert not grids.reached
    assert grids.solution.grid.n == 1024
    assert any("stopped at 32 x 32 cells by most_cells=" in note for note in grids.solution.notes)
    assert grids.stiffness == pytest.approx(grids.solution.attributes["analytic_stiffness"], rel=0.05)


@pytest.mark.parametrize("loading", [{"load": 0.0}, {"approach": 0.0}, {"approach": -1.0}])
def test_refinement_stops_without_pressure(loading):
    grids = refine(hertz(16), 1e-3, **loading)
    assert grids.reached and len(grids.rows) == 1


@pytest.mark.parametrize(("cells", "loading"), [(16, {"load": 80000.0}), (64, {"approach": APPROACH})])
def test_two_finer_grids_are_solved_before_refinement_stops(cells, loading):
    grids = refine(hertz(cells), 0.9, **loading)
    assert grids.reached and [row["nx"] for row in grids.rows] == [cells, 2 * cells, 4 * cells]


def test_a_refinement_that_has_no_room_for_two_finer_grids_says_so():
    grids = refine(hertz(16), 0.9, 32**2, load=80000.0)
    assert not grids.reached and len(grids.rows) == 2 and grids.errors.largest < 0.9
    [note] = [note for note in grids.solution.notes if "stopped at" in note]
    assert "most_cells= (-refine_max): 2 of at least 3 grids are solved" in note
    assert "NOT confirmed to be below 0.9" in refinement_table(grids, 0.9, ("max_pressure",))


def test_refinement_does_not_stop_at_grids_that_agree_by_chance():
    """A log-crowned roller: its maximum pressure hardly differs on 8 and 16 cells, and is 12% too small."""
    roller = Roller(5, 10, crown="log", end_chamfer=0.5, design_load=5000, contact_modulus=115385)
    steel = Material.pair((210e3, 210e3), (0.3, 0.3))
    grid = Grid.from_domain(16, 16, (-0.5, 0.5, -6.0, 6.0))
    grids = refine(ContactProblem(grid, steel, roller), 0.05, load=5000, quantities=("max_pressure",))
    for row in grids.rows:
        error = abs(row["max_pressure"] / 2285.5 - 1)
        assert 0.7 * error < row["max_pressure_error"], row["nx"]
    assert grids.reached and error < 0.05
    assert grids.solution.max_pressure_error == grids.errors.max_pressure_error


def test_refinement_stops_at_the_largest_grid_that_petsc_can_number(monkeypatch):
    def few(grid):
        if grid.n > 1024:
            raise InputError("too many")

    monkeypatch.setattr(refinement, "check_cells", few)
    grids = refine(hertz(16), 1e-6, load=80000.0)
    assert (grids.solution.grid.n, len(grids.rows)) == (1024, 2)


def test_a_problem_known_on_one_grid_cannot_be_refined():
    with pytest.raises(InputError, match="known on one grid only"):
        refine(self_affine(32), 0.1, load=3.0)
    with pytest.raises(InputError, match="refine until 2: must be"):
        refine(hertz(16), 2, load=3.0)


def test_errors_are_estimated_for_a_contact_small_in_its_period():
    """A line contact on 1.4% of a period: with coarse grids solved as well as the whole patch asks for, 69% and 33%."""
    grid = Grid.from_domain(1024, 1, (-8.0, 8.0, 0.0, 1.0))
    line = ContactProblem(grid, Material.from_contact_modulus(1e3), lambda x, y: x**2 / 20, periodic=True)
    solution = solve(line, None, None, load=1.0)
    exact = np.sqrt(1e3 / (10 * np.pi))  # sqrt(load a length E* / (pi R))
    assert abs(solution.max_pressure / exact - 1) < solution.max_pressure_error < 0.05
    assert solution.approach_error < 0.02


def test_finer_grids_are_solved_to_smaller_tolerances():
    """What 1e-6 leaves of the shortest waves moved the maximum pressure of fine grids more than the size of cells."""
    refined = refine(hertz(64), until=1e-3, approach=APPROACH)
    exact = hertz(64).reference(APPROACH)
    assert refined.reached and refined.solution.grid.nx <= 2048
    assert refined.solution.rtol == pytest.approx(1e-6 * 64 / refined.solution.grid.nx)
    errors = [abs(row["max_pressure"] / exact.max_pressure - 1) for row in refined.rows]
    assert all(finer < 0.6 * coarser for coarser, finer in pairwise(errors[:-1]))
    assert errors[-1] < 3e-6  # what the tolerance leaves


def test_refine_ignores_a_loading_that_is_none():
    sphere = ContactProblem(
        Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.combined(80000, 0.3), Sphere(20)
    )
    plain, found = (refine(sphere, 0.1, approach=0.003, **more) for more in ({}, {"load": None}))
    assert found.errors == plain.errors and found.errors.load_error > 0


def test_refine_uses_a_start_on_the_first_grid():
    sphere = ContactProblem(
        Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.combined(80000, 0.3), Sphere(20)
    )
    found = refine(sphere, 0.03, approach=0.01, start=solve(sphere, 0.01, None))
    assert len(found.rows) > 1 and found.reached


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("a relative error", lambda: refine(hertz(8), "0.1", load=1.0)),
        ("most_cells 'a'", lambda: refine(hertz(8), 0.1, load=1.0, most_cells="a")),
        ("most_cells nan", lambda: refine(hertz(8), 0.1, load=1.0, most_cells=np.nan)),
        ("a ContactProblem", lambda: refine("x", 0.1, load=1)),
    ],
)
def test_wrong_limits_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_a_problem_with_a_hardness_is_refined_if_it_is_one_number():
    refined = refine(replace(hertz(16), hardness=1000.0), until=0.1, load=9e4)
    assert refined.reached and refined.solution.max_pressure == 1000.0 and refined.solution.plastic.any()
    with pytest.raises(InputError, match="a hardness known on its grid only; must be a number"):
        refine(replace(hertz(16), hardness=np.full((16, 16), 1000.0)), until=0.1, load=9e4)
    with pytest.raises(InputError, match="a background pressure known on its grid only; must be a number"):
        refine(replace(hertz(16), background_pressure=np.ones((16, 16))), until=0.1, load=9e4)


def test_only_the_errors_of_chosen_quantities_count():
    """The maximum pressure of a punch does not converge; its approach does."""
    grid = Grid.from_domain(32, 32, (-1.0, 1.0, -1.0, 1.0))
    punch = ContactProblem(grid, Material.combined(8e4, 0.3), FlatPunch(1.0))
    refined = refine(punch, 0.05, load=100, quantities=("approach",), most_cells=256**2)
    assert refined.reached and refined.errors.approach_error <= 0.05 < refined.errors.max_pressure_error


@pytest.mark.parametrize(
    ("quantities", "said"),
    [
        ("load", "must be among"),
        ((), "must be among"),
        (("area",), "must be among"),
        (("load",), "prescribed"),
    ],
)
def test_quantities_to_refine_for_are_checked(quantities, said):
    with pytest.raises(InputError, match=f"quantities= .-refine_for.*{said}"):
        refine(hertz(16), 0.1, load=100, quantities=quantities)
