"""Stress waves in a layer and its base."""

import numpy as np
import pytest

from app.halfspace.layer import Layer
from app.halfspace.layer_waves import LayerWaves

THICKNESS = 2.0
BODIES = [
    ((1.0, 10.0), (0.3, 0.2)),
    ((10.0, 1.0), (0.25, 0.5)),
    ((1e3, 1.0), (0.5, 0.0)),
    ((1.0, np.inf), (0.3, 0.0)),
    ((1.0, np.inf), (0.5, 0.0)),
]
bodies = pytest.mark.parametrize(("young", "poisson"), BODIES)
X = np.concatenate([np.geomspace(1e-6, 0.9, 30), [1 - 1e-9, 1.0], np.geomspace(1.1, 2000, 30)])


def waves(young, poisson, x=X):
    layer = Layer(THICKNESS, young, poisson)
    return layer, LayerWaves(layer, x / layer.thickness)


def displacements(layer, response, depth):
    """Displacements at a depth in the layer, by the module's formulas."""
    nu, (a, a1, a2, a3) = layer.poisson[0], response._layer_functions(depth)
    return (1 - nu) * a3 - (2 - nu) * a1, (1 - nu) * a2 + nu * a


def half_space(s):
    """The stress function of a half-space, and two derivatives."""
    return (1 + s) * np.exp(-s), -s * np.exp(-s), (s - 1) * np.exp(-s)


@bodies
def test_surface_carries_the_pressure_and_is_displaced_as_the_ratio_says(young, poisson):
    layer, response = waves(young, poisson)
    value, slope, _ = response.functions(0.0)
    np.testing.assert_allclose(value, 1, atol=1e-14)
    np.testing.assert_allclose(slope, 0, atol=1e-14)
    normal, _ = displacements(layer, response, 0.0)
    ratio = layer.ratio(X / THICKNESS)
    np.testing.assert_allclose(normal / (2 - 2 * poisson[0]), ratio, rtol=0, atol=1e-12 * max(1, ratio.max()))


@bodies
def test_stresses_and_displacements_are_continuous_at_the_interface(young, poisson):
    layer, response = waves(young, poisson)
    u_z, u_x = displacements(layer, response, THICKNESS)
    if layer.on_rigid_base:
        np.testing.assert_allclose([u_z, u_x], 0, atol=1e-13)
        return
    value, slope, _ = response.functions(THICKNESS)
    below = np.nextafter(THICKNESS, np.inf)
    step = 1e-3 * THICKNESS / np.maximum(X, 1e-3)  # of each wave; a... by differences
    deeper = [
        np.array(
            [
                waves(young, poisson, X[k : k + 1])[1].functions(below + m * h)[2][0]
                for k, h in enumerate(step)
            ]
        )
        for m in (0, 1, 2)
    ]
    third = (4 * deeper[1] - 3 * deeper[0] - deeper[2]) / (2 * step * X / THICKNESS)
    base_value, base_slope, curvature = response.functions(below)
    np.testing.assert_allclose(base_value, value, atol=1e-13)
    np.testing.assert_allclose(base_slope, slope, atol=1e-13)
    nu, mu = poisson[1], layer.modulus_ratio
    base_x, base_z = (1 - nu) * curvature + nu * base_value, (1 - nu) * third - (2 - nu) * base_slope
    np.testing.assert_allclose(u_x, mu * base_x, atol=1e-12 * mu)
    np.testing.assert_allclose(u_z, mu * base_z, atol=1e-5 * mu)


@bodies
@pytest.mark.parametrize("depth", [0.3, 1.6, 2.7])
def test_forces_are_in_equilibrium(young, poisson, depth):
    """The second function is the derivative of the first, and so on: differences differ by a square."""
    layer, response = waves(young, poisson, np.array([1e-3, 0.1, 0.7, 1.5, 6.0]))
    if layer.on_rigid_base and depth > THICKNESS:
        with pytest.raises(ValueError, match="rigid base"):
            response.functions(depth)
        return
    q, errors = np.array([1e-3, 0.1, 0.7, 1.5, 6.0]) / THICKNESS, []
    for step in (0.02, 0.01):
        low, high = (np.array(response.functions(depth + side * step)) for side in (-1, 1))
        slopes = (high - low)[:2] / (2 * step * q)
        errors.append(abs(slopes - response.functions(depth)[1:]))
    assert (errors[1] < 0.26 * errors[0] + 1e-10).all()
    assert errors[1].max() < 1e-3


def test_equal_materials_are_a_half_space():
    _, response = waves((3.0, 3.0), (0.3, 0.3))
    for depth in (0.0, 0.7, THICKNESS, 2.5, 7.0):
        np.testing.assert_allclose(response.functions(depth), half_space(X / THICKNESS * depth), atol=1e-13)
    np.testing.assert_allclose(response.functions(1.7, reflected=True), 0, atol=1e-14)


def test_short_waves_do_not_reach_the_base_and_long_ones_do_not_see_the_layer():
    _, response = waves((10.0, 1.0), (0.3, 0.2), np.array([1e-5, 60.0]))
    for depth in (0.0, 0.1, 0.5):
        short = np.array(response.functions(depth))[:, 1]
        np.testing.assert_allclose(short, half_space(30 * depth), atol=1e-13)
    deep = 3e5  # some wave lengths of the long wave
    np.testing.assert_allclose(
        np.array(response.functions(deep))[:, 0], half_space(0.5e-5 * deep), rtol=1e-3, atol=1e-4
    )
