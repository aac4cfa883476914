"""The errors that the size of the cells makes, from two grids; refining until they are small."""

from itertools import pairwise

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough, self_affine
from running import solve

import app
from app import (
    ContactProblem,
    FlatPunch,
    Grid,
    Material,
    SelfAffineSurface,
    Sphere,
    refine,
)
from app.api import refinement
from app.base.errors import InputError
from app.contact.grid_errors import GridNumbers, estimate_errors

PAIRS = {"load": "load_error", "max_pressure": "max_pressure_error", "contact_area": "contact_area_error"}


@pytest.mark.parametrize("n", [32, 48, 64, 96, 128, 256])
def test_estimates_of_a_default_run_on_hertz_are_no_less_than_the_errors(n):
    solution, known = solve(hertz(n), APPROACH, None), hertz(n).reference(APPROACH)
    for name, estimate in PAIRS.items():
        error, estimated = (
            abs(getattr(solution, name) / getattr(known, name) - 1),
            getattr(solution, estimate),
        )
        assert error < estimated < 60 * error + 2 / n, name
    assert solution.approach_error == 0


def grids_of(*pressures):
    return [GridNumbers(1.0, 1.0, pressure, 1.0) for pressure in pressures]


@pytest.mark.parametrize("order", [1.0, 1.5, 2.0])
def test_the_estimate_bounds_the_error_of_whatever_converges(order):
    """With order 1 it is the error itself, with 2 at most 6 times; two grids that agree by chance do not lower it."""
    values = [1 + 0.3 * 2.0 ** (-order * level) for level in range(5)]
    error = abs(1 - 1 / values[-1])
    estimated = estimate_errors(grids_of(*values), 0.0, "approach").max_pressure_error
    assert error * (1 - 1e-12) <= estimated <= 6.1 * error
    by_chance = grids_of(*values[:-1], values[-2])
    assert (
        estimate_errors(by_chance, 0.0, "approach").max_pressure_error
        >= (values[-3] - values[-2]) / 2 / values[-2]
    )


@pytest.mark.parametrize("growth", [1.0, 2**0.5])
def test_what_does_not_converge_is_told(growth):
    """Pressures that grow like the logarithm, or the root, of the number of cells; and those of a rigid punch."""
    steps = np.cumsum(growth ** np.arange(5))
    assert estimate_errors(grids_of(*(1 + steps)), 0.0, "approach").max_pressure_error == 1
    assert (
        estimate_errors(grids_of(*(1 + steps)[:2]), 0.0, "approach").max_pressure_error < 1
    )  # two grids cannot know
    assert np.isnan(estimate_errors(grids_of(1.0), 0.0, "approach").load_error)


def test_what_hardly_changes_converges_though_its_changes_do_not_fall():
    """A rough punch on 256 x 256 cells, 97% in contact: finer grids say that its area is 0.3% too large."""
    areas = 0.9756, 0.9759, 0.9711, 0.9669
    grids = [GridNumbers(1.0, 1.0, 1.0, area) for area in areas]
    slow = [GridNumbers(1.0, 1.0, 1.0, area) for area in (0.9796, 0.9754, 0.9711, 0.9669)]
    for numbers in grids, slow:
        assert 0.003 < estimate_errors(numbers, 0.0, "load").contact_area_error < 0.05


@pytest.mark.parametrize(("seed", "load", "area"), [(2, 10, 0.007684), (11, 10, 0.008133)])
def test_cells_just_captured_on_a_coarse_grid_are_no_area(seed, load, area):
    """A rough ball; area of twice and four times as many cells. Coarse grids are left before such cells leave again."""
    surface = SelfAffineSurface(0.8, 0.1, 0.008, (0.4, 0.4), seed=seed, rms_height=1.5e-4)
    grid = Grid.from_domain(512, 512, (-0.13, 0.13, -0.13, 0.13))
    steel = Material.pair((210e3, 210e3), (0.3, 0.3))
    found = app.solve(ContactProblem(grid, steel, Sphere(5), surfaces=[surface]), load=load)
    error = abs(found.contact_area / area - 1)
    assert error < found.contact_area_error < 5 * error


def test_the_rim_of_a_punch_does_not_converge_its_load_does():
    grid = Grid.from_domain(128, 128, (-1.0, 1.0, -1.0, 1.0))
    punch = ContactProblem(grid, Material.combined(8e4, 0.3), FlatPunch(1.0))
    solution = solve(punch, 1e-3, None)
    assert solution.max_pressure_error == 1
    exact = 2 * punch.material.contact_modulus * 0.5 * 1e-3
    assert abs(solution.load / exact - 1) < solution.load_error < 0.2


def test_of_a_load_the_approach_is_uncertain():
    solution = solve(hertz(64), None, None, load=80000.0)
    assert solution.load_error == 0
    assert (
        0
        < abs(solution.approach / solution.attributes["analytic_approach"] - 1)
        < solution.approach_error
        < 0.01
    )


@pytest.mark.parametrize("loading", [{"mean_pressure": 300.0}, {"approach": -1e-3}])
def test_estimates_on_a_periodic_rough_surface(loading):
    grids = refine(periodic_rough(64), 1e-9, 128**2, **loading)
    coarse, fine = grids.rows
    for name, estimate in PAIRS.items():
        assert abs(coarse[name] / fine[name] - 1) <= coarse[estimate] + 1e-12, name
    assert abs(coarse["approach"] / fine["approach"] - 1) <= coarse["approach_error"] + 1e-12


@pytest.mark.parametrize("mean_gap", [0.01, 0.005])
@pytest.mark.parametrize("power", [1.0, 1.5])
def test_a_mean_gap_prescribes_neither_load_nor_approach(power, mean_gap):
    """The mean undeformed distance of a function is another one on every grid."""

    def body(n):
        grid = Grid.from_domain(n, n, (-1.0, 1.0, -1.0, 1.0), periodic=True)
        return ContactProblem(grid, Material.combined(8e4, 0.3), lambda x, y: (x**2 + y**2) ** power / 40)

    best = app.solve(body(256), mean_gap=mean_gap)
    for n in (16, 32, 64):
        solution = app.solve(body(n), mean_gap=mean_gap)
        for name in ("load", "approach", "max_pressure"):
            error = abs(getattr(solution, name) / getattr(best, name) - 1)
            assert 0 < error < getattr(solution, f"{name}_error") < 0.2
    grids = refine(body(16), 0.05, mean_gap=mean_gap)
    assert abs(grids.solution.approach / best.approach - 1) < grids.errors.approach_error < 0.05


def test_without_a_coarser_grid_nothing_is_known():
    for method, options in ((None, {"lcp_nested": False}), ("norm", {})):
        solution = solve(hertz(32), APPROACH, method, **options)
        assert np.isnan([getattr(solution, name) for name in PAIRS.values()]).all()


def test_refines_until_the_errors_are_small():
    grids = refine(hertz(16), 0.01, approach=APPROACH)
    assert grids.reached
    assert [row["nx"] for row in grids.rows] == [16 * 2**k for k in range(len(grids.rows))]
    assert not any("refined" in note for note in grids.solution.notes)
    assert grids.errors.largest <= 0.01 < max(grids.rows[-2][name] for name in PAIRS.values())
    known = hertz(16).reference(APPROACH)
    for name in PAIRS:
        assert getattr(grids.solution, name) == pytest.approx(getattr(known, name), rel=0.01)


def test_stops_at_the_largest_grid():
    grids = refine(hertz(16), 1e-6, 2000, load=80000.0, stiffness=True)
    assert not grids.reached
    assert grids.solution.grid.n == 1024
    assert "refined to 32 x 32 cells, not to errors below 1e-06" in grids.solution.notes
    assert grids.stiffness == pytest.approx(grids.solution.attributes["analytic_stiffness"], rel=0.05)


@pytest.mark.parametrize("loading", [{"load": 0.0}, {"approach": 0.0}, {"approach": -1.0}])
def test_without_a_pressure_there_is_nothing_to_refine(loading):
    grids = refine(hertz(16), 1e-3, **loading)
    assert grids.reached and len(grids.rows) == 1


def test_no_error_is_more_than_all():
    grids = [GridNumbers(1.0, 1.0, 1.0, area, 0.25**k) for k, area in enumerate((50.0, 10.0, 1.0))]
    assert estimate_errors(grids, 0.0, "load").contact_area_error == 1.0


def test_stops_before_the_largest_grid_that_petsc_can_count(monkeypatch):
    def few(grid):
        if grid.n > 1024:
            raise InputError("too many")

    monkeypatch.setattr(refinement, "check_cells", few)
    grids = refine(hertz(16), 1e-6, load=80000.0)
    assert (grids.solution.grid.n, len(grids.rows)) == (1024, 2)


def test_refuses_what_has_no_finer_grid():
    with pytest.raises(InputError, match="known on its own grid only, there is no finer one"):
        refine(self_affine(32), 0.1, load=3.0)
    with pytest.raises(InputError, match="refine until 2: must be"):
        refine(hertz(16), 2, load=3.0)


def test_a_contact_that_is_small_in_its_period_is_known_on_coarse_grids_too():
    """A line contact on 1.4% of a period: with coarse grids solved as well as the whole patch asks for, 69% and 33%."""
    grid = Grid.from_domain(1024, 1, (-8.0, 8.0, 0.0, 1.0))
    line = ContactProblem(grid, Material.from_contact_modulus(1e3), lambda x, y: x**2 / 20, periodic=True)
    solution = solve(line, None, None, load=1.0)
    exact = np.sqrt(1e3 / (10 * np.pi))  # sqrt(load a length E* / (pi R))
    assert abs(solution.max_pressure / exact - 1) < solution.max_pressure_error < 0.05
    assert solution.approach_error < 0.02


def test_an_area_that_scatters_by_its_rim_converges():
    """README's ball at 256 x 256: 11272, 2844, 716 and 180 cells in contact; larger steps would have to fall."""
    cells = np.array([180, 716, 2844, 11272]) / 4.0 ** np.arange(4)
    for times, least, most in ((1, 5e-3, 0.02), (3, 0.25, 0.3)):
        areas = cells[-1] + times * (cells - cells[-1])
        grids = [GridNumbers(1.0, 1.0, 1.0, area, 0.25**k) for k, area in enumerate(areas)]
        assert least <= estimate_errors(grids, 0.0, "load").contact_area_error <= most


def test_finer_grids_are_solved_better():
    """What 1e-6 leaves of the shortest waves moved the maximum pressure of fine grids more than the size of cells."""
    refined = refine(hertz(64), until=1e-3, approach=APPROACH)
    exact = hertz(64).reference(APPROACH)
    assert refined.reached and refined.solution.grid.nx <= 2048
    assert refined.solution.rtol == pytest.approx(1e-6 * 64 / refined.solution.grid.nx)
    errors = [abs(row["max_pressure"] / exact.max_pressure - 1) for row in refined.rows]
    assert all(finer < 0.6 * coarser for coarser, finer in pairwise(errors[:-1]))
    assert errors[-1] < 3e-6  # what the tolerance leaves


def test_a_loading_that_is_none_says_nothing():
    sphere = ContactProblem(
        Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.combined(80000, 0.3), Sphere(20)
    )
    plain, found = (refine(sphere, 0.1, approach=0.003, **more) for more in ({}, {"load": None}))
    assert found.errors == plain.errors and found.errors.load_error > 0


def test_a_start_is_that_of_the_first_grid():
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
