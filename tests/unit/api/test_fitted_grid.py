"""Grids whose patch is fitted to the contact."""

import numpy as np
import pytest

from app import Cone, ContactProblem, FlatPunch, Grid, Material, Paraboloid, Roller, Sphere, fit_grid, solve
from app.base.errors import InputError
from app.problems.default_patch import default_patch
from app.problems.shapes import Shape

STEEL = Material.isotropic(210e3, 0.3)


def tilted_saddle_free(x, y):
    return (x - 0.2) ** 2 / 30 + (y + 7) ** 2 / 5000 + 1e-5 * (x - 0.2) * (y + 7)


GAPS = [Sphere(4), Paraboloid(900, 3), Cone(2), FlatPunch(2), Roller(8, 6), tilted_saddle_free,
        lambda x, y: (x**2 + y**2) ** 2 / 1e6, lambda x, y: 1e3 * (x**2 + y**2)]  # fmt: skip


@pytest.mark.parametrize("loading", [{"load": 50.0}, {"approach": 5e-4}])
@pytest.mark.parametrize("gap", GAPS)
def test_contact_fills_more_than_half_of_the_sides_and_reaches_none(gap, loading):
    grid = fit_grid(gap, STEEL, 48, **loading)
    contact = solve(ContactProblem(grid, STEEL, gap), **loading).contact
    assert grid.shape == (48, 48)
    for axis in (0, 1):
        along = contact.any(axis=axis)
        assert not along[0] and not along[-1] and np.count_nonzero(along) >= 24


@pytest.mark.parametrize("gap", [Sphere(4), Cone(2), Roller(8, 6), tilted_saddle_free])
def test_the_patch_has_room_for_plastic_contact(gap):
    for hardness in 10.0, 1e9:
        grid = fit_grid(gap, STEEL, 48, load=50, hardness=hardness)
        contact = solve(ContactProblem(grid, STEEL, gap, hardness=hardness), load=50).contact
        for axis in (0, 1):
            along = contact.any(axis=axis)
            assert not along[0] and not along[-1] and np.count_nonzero(along) >= 24
        if isinstance(gap, Shape):  # from theory
            patch = default_patch(gap, STEEL.contact_modulus, load=50, hardness=hardness)
            grid = Grid.from_domain(48, 48, patch)
            contact = solve(ContactProblem(grid, STEEL, gap, hardness=hardness), load=50).contact
            edge = np.concatenate([contact[:, [0, -1]].ravel(), contact[[0, -1]].ravel()])
            assert contact.any() and not edge.any()


def test_the_patch_to_begin_with_does_not_matter():
    for patch in ((-50, 60, -20, 9), (-0.01, 0.01, -0.01, 0.01)):
        grid = fit_grid(Sphere(4), STEEL, (40, 20), patch, load=50)
        contact = solve(ContactProblem(grid, STEEL, Sphere(4)), load=50)
        assert grid.shape == (20, 40)
        assert grid.nx * grid.dx == pytest.approx(3 * contact.semi_axis_major, rel=0.15)


def test_the_bodies_ends_stay_edges_of_cells():
    roller = Roller(8, 6, end_chamfer=0.5)
    grid = fit_grid(roller, STEEL, 64, load=2000)
    assert np.count_nonzero(np.abs(grid.y()) <= 2.5) * grid.dy == pytest.approx(5, rel=1e-9)


@pytest.mark.parametrize(
    ("gap", "loading", "message"),
    [
        (Sphere(4), {}, "exactly one"),
        (Sphere(4), {"load": 1.0, "approach": 1.0}, "exactly one"),
        (Sphere(4), {"load": 0.0}, "must be positive"),
        (lambda x, y: 1 + x**2 + y**2, {"approach": 0.5}, "no contact at the approach 0.5"),
        (lambda x, y: 0 * x * y, {"load": 1.0}, "no patch contains the contact"),
        (lambda x, y: x**2 + 0 * y, {"load": 1.0}, "no patch contains the contact"),
    ],
)
def test_gaps_without_a_patch_are_refused(gap, loading, message):
    with pytest.raises(InputError, match=message):
        fit_grid(gap, STEEL, **loading)
