"""The surface displacement of a layer under a wave of pressure."""

import numpy as np
import pytest

from app.halfspace import layer as layer_module
from app.halfspace.layer import Layer

MATERIALS = {  # Young's moduli and Poisson's ratios of layer and substrate
    "soft": ((1.0, 10.0), (0.3, 0.2)),
    "stiff": ((10.0, 1.0), (0.2, 0.45)),
    "incompressible": ((1.0, 7.0), (0.5, 0.3)),
    "rigid base": ((1.0, np.inf), (0.3, 0.0)),
    "incompressible on a rigid base": ((1.0, np.inf), (0.5, 0.0)),
}


def bonded(young, poisson, x):
    """The ratio S by the equations of two bonded layers, with Love's function, for q = 1.

    L = (A + B z) exp(-z) + (C + D z) exp(-(x - z)) in the layer, (A2 + B2 (z - x)) exp(-(z - x)) below.
    """

    def derivatives(z, powers, sign, shift):
        # of z^power exp(sign z + shift), up to the third
        e = np.exp(sign * z + shift)
        return (
            np.array([[z**p * sign**k + p * k * sign ** max(k - 1, 0) for k in range(4)] for p in powers]) * e
        )

    def quantities(terms, nu, modulus):
        # u_z, u_x, s_zz, s_xz, up to common factors, for each term of L
        L, d1, d2, d3 = terms.T
        g = modulus / (2 * (1 + nu))
        return np.array([
            ((1 - 2 * nu) * d2 - 2 * (1 - nu) * L) / (2 * g), -d1 / (2 * g),
            (1 - nu) * d3 - (2 - nu) * d1, -nu * d2 - (1 - nu) * L,
        ])  # fmt: skip

    (e1, e2), (nu1, nu2) = young, poisson

    def layer(z):
        return quantities(
            np.concatenate([derivatives(z, (0, 1), -1, 0), derivatives(z, (0, 1), 1, -x)]), nu1, e1
        )

    top, bottom = layer(0.0), layer(x)
    system, right = np.zeros((6, 6)), np.zeros(6)
    system[0, :4], system[1, :4], right[0] = top[2], top[3], -1.0
    if np.isinf(e2):
        system[2:4, :4], system[4:, 4:] = bottom[:2], np.eye(2)
    else:
        below = quantities(derivatives(0.0, (0, 1), -1, 0), nu2, e2)
        system[2:, :4], system[2:, 4:] = bottom, -below
    scale = abs(system).max(axis=1)
    u = top[0] @ np.linalg.solve(system / scale[:, None], right / scale)[:4]
    return u * e1 / (2 * (1 - nu1**2))


@pytest.mark.parametrize("x", [0.2, 0.7, 1.5, 4.0])
@pytest.mark.parametrize("name", MATERIALS)
def test_displacement_is_that_of_bonded_layers(name, x):
    young, poisson = MATERIALS[name]
    assert Layer(1.0, young, poisson).ratio(x) == pytest.approx(bonded(young, poisson, x), rel=1e-10)


@pytest.mark.parametrize("name", MATERIALS)
def test_both_forms_agree_where_neither_cancels(name):
    (e1, e2), (nu1, nu2) = MATERIALS[name]
    x, mu = np.linspace(0.5, 0.99, 20), (e1 / (1 + nu1)) / (e2 / (1 + nu2))
    small, large = (
        getattr(layer_module, f"_ratio_of_{kind}_waves")(x, mu, nu1, nu2) for kind in ("long", "short")
    )
    np.testing.assert_allclose(small, large, rtol=1e-12)


@pytest.mark.parametrize("name", MATERIALS)
def test_short_waves_see_the_layer_and_long_waves_the_substrate(name):
    (e1, e2), (nu1, nu2) = young, poisson = MATERIALS[name]
    layer = Layer(1.0, young, poisson)
    assert layer.ratio(30.0) == pytest.approx(1, rel=1e-15)
    assert layer.ratio(1e6) == 1
    substrate = (1 - nu2**2) / e2 / ((1 - nu1**2) / e1)
    assert layer.ratio(1e-12) == pytest.approx(substrate, rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_stiff_substrate_is_a_rigid_base(nu):
    """The difference is proportional to the compliance of the substrate."""
    x = np.geomspace(0.1, 10, 20)
    rigid = Layer(1.0, (1.0, np.inf), (nu, 0.0)).ratio(x)
    for stiffness in (1e4, 1e8):
        found = Layer(1.0, (1.0, stiffness), (nu, 0.3)).ratio(x)
        assert abs(found - rigid).max() < 2 / stiffness


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_long_waves_press_a_layer_on_a_rigid_base_uniformly(nu):
    layer, q = Layer(0.2, (3.0, np.inf), (nu, 0.0)), 1e-6
    modulus = 3.0 * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert layer.uniform_compliance == pytest.approx(0.2 / modulus, rel=1e-14)
    assert 2 * np.pi * layer.plane_compliance * layer.ratio(q) / q == pytest.approx(0.2 / modulus, rel=1e-9)


def test_an_incompressible_layer_on_a_rigid_base_bulges():
    """Lubrication theory: u = q^2 t^3 p / (3 G)."""
    layer, q = Layer(0.2, (3.0, np.inf), (0.5, 0.0)), 1e-3
    assert layer.uniform_compliance == 0
    u = 2 * np.pi * layer.plane_compliance * layer.ratio(q) / q
    assert u == pytest.approx(q**2 * 0.2**3 / 3.0, rel=1e-6)  # G = 1
