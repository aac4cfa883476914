"""Base shapes."""

from functools import partial

import numpy as np
import pytest

from app import Cone, Cylinder, FlatPunch, Grid, InputError, Paraboloid, Sphere


@pytest.mark.parametrize("angle", [0, 25, 60, 90, -40])
@pytest.mark.parametrize(
    ("radii1", "radii2"), [((20, 50), (30, 90)), ((40, 20), (15, -60)), ((9, 9), (7, 8))]
)
def test_relative_paraboloid_is_the_sum_of_both_bodies(radii1, radii2, angle):
    """In the turned axes, up to round-off, and with x next to body 1's first axis."""
    shape = Paraboloid.between(radii1, radii2, angle)
    turn = np.radians(shape.bodies[3])
    assert abs(turn) <= np.pi / 4 + 1e-12
    x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))

    def body(radii, degrees):
        to = np.radians(degrees) - turn
        first, second = x * np.cos(to) + y * np.sin(to), y * np.cos(to) - x * np.sin(to)
        return first**2 / (2 * radii[0]) + second**2 / (2 * radii[1])

    np.testing.assert_allclose(shape.distance(x, y), body(radii1, 0) + body(radii2, angle), atol=1e-15)


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        (((20, np.inf), (30, np.inf), 0), "line contact, see -problem cylinder"),
        (((20, -10), (30, np.inf), 0), "both be positive"),
        (((0, 1), (1, 1), 0), "radii of body 1"),
    ],
)
def test_bodies_without_a_contact_ellipse_are_refused(radii, message):
    with pytest.raises(ValueError, match=message):
        Paraboloid.between(*radii)


@pytest.mark.parametrize("shape", [Sphere, Cylinder, partial(Cylinder, 1.0), Cone, FlatPunch])
@pytest.mark.parametrize("size", [0, -1.0, np.nan, "6", None])
def test_sizes_that_are_not_positive_are_refused(shape, size):
    with pytest.raises(InputError, match="must be"):
        shape(size)


@pytest.mark.parametrize(("corner", "touches"), [(-1.0, True), (0.353, True), (0.354, False)])
def test_a_punch_is_found_on_a_huge_grid(corner, touches):
    punch, grid = FlatPunch(1.0), Grid.from_domain(10**6, 10**6, (corner, 2, corner, 2))
    if touches:
        punch.check_grid(grid)
    else:
        with pytest.raises(InputError, match="no cell centre"):
            punch.check_grid(grid)


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        ("angle 'x'", lambda: Paraboloid.between((20, 20), (20, 20), angle="x")),
        ("body 1: .*two numbers", lambda: Paraboloid.between(0, 60)),
        ("a number", lambda: Sphere("10")),
    ],
)
def test_wrong_bodies_are_refused(message, wrong):
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)
