"""Default patches hold the contact, and not much more."""

import numpy as np
import pytest

from app import (
    Cone,
    ContactProblem,
    Cylinder,
    FlatPunch,
    Grid,
    InputError,
    Material,
    Paraboloid,
    Plane,
    Roller,
    Sphere,
    solve,
)
from app.problems.default_patch import default_patch

STEEL = Material.isotropic(210e3, 0.3)
SHAPES = [Sphere(5), Paraboloid(10, 800), Cone(1), Cylinder(8, 6), FlatPunch(3), Roller(8, 6),
          Roller(8, 6, "arc", crown_radius=200), Roller(8, 6, "arc", crown_radius=20000)]  # fmt: skip


@pytest.mark.parametrize("loading", [{"load": 200.0}, {"approach": 0.002}])
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_contact_is_inside_and_has_a_third_of_each_side(shape, loading):
    patch = default_patch(shape, STEEL.contact_modulus, **loading)
    solution = solve(ContactProblem(Grid.from_domain(48, 48, patch), STEEL, shape), **loading)
    assert solution.notes == ()
    for axis in (0, 1):
        assert 16 <= np.count_nonzero(solution.contact.any(axis=axis)) < 48


@pytest.mark.parametrize(
    ("shape", "loading", "message"),
    [
        (Plane(), {"load": 1.0}, "contact of this plane has no end"),
        (Cylinder(1.0), {"load": 1.0}, "contact of this cylinder has no end"),
        (Sphere(1.0), {}, "for an approach or load only"),
        (Sphere(1.0), {"load": 0.0}, "without contact"),
        (Roller(1.0, 2.0), {"approach": -0.1}, "without contact"),
    ],
)
def test_shapes_without_a_patch_are_refused(shape, loading, message):
    with pytest.raises(InputError, match=message):
        default_patch(shape, 1e5, **loading)
