"""State of numpy that the user's program has changed."""

from contextlib import contextmanager

import numpy as np
import pytest

from app import ContactProblem, Grid, Material, Paraboloid, Sphere, solve, stress


def _raise(kind, _):
    raise AssertionError(kind)


@contextmanager
def _changed(**modes):
    with np.errstate(**modes), np.printoptions(precision=1, threshold=2):
        yield


@pytest.mark.parametrize("modes", [{"all": "raise"}, {"all": "call", "call": _raise}])
@pytest.mark.parametrize("periodic", [False, True, "x", "y"])
@pytest.mark.parametrize("thickness", [None, 0.002])
def test_errors_of_numpy_that_the_user_has_switched_on_are_not_ours(modes, periodic, thickness):
    """Small terms of sums of waves and of layers underflow."""
    material = Material.isotropic(2e5, 0.3)
    if thickness:
        material = Material.coated((2e5, 1e5), (0.3, 0.3), thickness=thickness)
    with _changed(**modes):
        before = np.geterr()
        grid = Grid.from_domain(32, 200, (-0.2, 0.2, -3, 3))
        solution = solve(ContactProblem(grid, material, Paraboloid(9, 700), periodic=periodic), load=50)
        below = stress(solution)
        assert below.maximum().von_mises > 0
        for depth in (1e-5, 0.1, 1e4):
            assert np.isfinite(below.plane(depth)).all()
        solution.plot()
        assert solution._repr_html_()
        assert np.geterr() == before


def test_the_first_touch_and_no_contact_raise_no_error_of_numpy():
    problem = ContactProblem(
        Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.isotropic(2e5, 0.3), Sphere(8)
    )
    with _changed(all="raise"):
        for approach in (0, -1):
            assert stress(solve(problem, approach=approach)).maximum().von_mises == 0
