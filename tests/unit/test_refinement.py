"""The errors that the size of the cells makes, from two grids; refining until they are small."""

import numpy as np
import pytest
from cases import APPROACH, hertz, periodic_rough, self_affine
from running import solve

from app import refine
from app.errors import InputError

PAIRS = {"load": "load_error", "max_pressure": "max_pressure_error", "contact_area": "contact_area_error"}


@pytest.mark.parametrize("n", [64, 128, 256])
def test_estimates_of_a_default_run_on_hertz_are_no_less_than_the_errors(n):
    solution, known = solve(hertz(n), APPROACH, None), hertz(n).reference(APPROACH)
    for name, estimate in PAIRS.items():
        error, estimated = (
            abs(getattr(solution, name) / getattr(known, name) - 1),
            getattr(solution, estimate),
        )
        assert error < estimated < 60 * error + 2 / n, name
    assert solution.approach_error == 0


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


def test_without_a_coarser_grid_nothing_is_known():
    for method, options in ((None, {"lcp_nested": False}), ("norm", {})):
        solution = solve(hertz(32), APPROACH, method, **options)
        assert np.isnan([getattr(solution, name) for name in PAIRS.values()]).all()


def test_refines_until_the_errors_are_small():
    grids = refine(hertz(16), 0.01, approach=APPROACH)
    assert grids.reached
    assert [row["nx"] for row in grids.rows] == [16 * 2**k for k in range(len(grids.rows))]
    assert grids.errors.largest <= 0.01 < max(grids.rows[-2][name] for name in PAIRS.values())
    known = hertz(16).reference(APPROACH)
    for name in PAIRS:
        assert getattr(grids.solution, name) == pytest.approx(getattr(known, name), rel=0.01)


def test_stops_at_the_largest_grid():
    grids = refine(hertz(16), 1e-6, 2000, load=80000.0, stiffness=True)
    assert not grids.reached
    assert grids.solution.grid.n == 1024
    assert grids.stiffness == pytest.approx(grids.solution.attributes["analytic_stiffness"], rel=0.05)


def test_refuses_what_has_no_finer_grid():
    with pytest.raises(InputError, match="known on its own grid only, there is no finer one"):
        refine(self_affine(32), 0.1, load=3.0)
    with pytest.raises(InputError, match="refine until 2: allowed"):
        refine(hertz(16), 2, load=3.0)
