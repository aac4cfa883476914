"""Stress waves in layers, against an independent solution and a published one.

The independent solution integrates the equations of elasticity in depth, for any number of layers, without a stress
function. It reproduces the stresses below a circular load on three layers by the program ELLEA1 (E. Levenberg, 2016),
as tabulated with the program ALVA (A. Skar, S. Andersen, J. Open Source Software 5 (2020) 2548).
"""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import j1

from app.halfspace.layer import Layer
from app.halfspace.layer_waves import LayerWaves

# Below the middle of a circle of radius 150 mm under 1.1 N/mm2: depth [mm], sigma_r and sigma_z [N/mm2], compression
# positive. The layers have 3000, 200 and 40 N/mm2, Poisson's ratios 0.3, 0.35 and 0.4, and end at 150 and 750 mm.
ELLEA1 = [
    (50, 0.8803, 0.9271), (100, -0.3396, 0.5405), (150, -1.6757, 0.2752), (200, 0.0067, 0.2172),
    (300, -0.0064, 0.1388), (400, -0.0149, 0.0911), (500, -0.0233, 0.0598), (750, -0.0600, 0.0220),
    (1000, -0.0005, 0.0146),
]  # fmt: skip


def rates(young, nu):
    """Return M with d/ds (q u_x, q u_z, s_xz, s_zz) = M (the same four), s = q z."""
    shear, ratio = young / (2 + 2 * nu), nu / (1 - nu)
    return np.array([[0, 1, 1 / shear, 0], [-ratio, 0, 0, (1 - ratio) / (2 * shear)],
                     [2 * shear / (1 - nu), 0, 0, ratio], [0, 0, -1, 0]])  # fmt: skip


def stress_waves(slabs, base, q):
    """Return sigma_xx, sigma_zz and sigma_xz at the bottom of each slab, by pressure waves of amplitude 1.

    A slab is (Young's modulus, Poisson's ratio, thickness). The base is (Young's modulus, Poisson's ratio).
    """
    upwards = {slab: expm(-rates(*slab[:2]) * (slab[2] * q)[:, None, None]) for slab in set(slabs)}
    # The base is a layer of thickness 40 / q on a rigid base, in steps of 1 / q.
    upwards = [expm(-rates(*base))] * 40 + [upwards[slab] for slab in reversed(slabs)]
    flexibility, transfers = np.zeros((q.size, 2, 2)), []
    for up in upwards:
        down = np.linalg.inv(up[..., 2:, :2] @ flexibility + up[..., 2:, 2:])
        transfers.insert(0, (down, flexibility))
        flexibility = (up[..., :2, :2] @ flexibility + up[..., :2, 2:]) @ down
    stress, result = np.tile([[0.0], [-1.0]], (q.size, 1, 1)), []
    for (young, nu, _), (down, flexibility) in zip(slabs, transfers[: len(slabs)], strict=True):
        stress = down @ stress
        (shear, normal), along = stress[..., 0].T, (flexibility @ stress)[:, 0, 0]
        result.append([(young / (1 + nu) * along + nu * normal) / (1 - nu), normal, shear])
    return np.array(result)


def test_independent_solution_has_the_published_stresses():
    edges = np.append(np.geomspace(1e-6, 0.01, 20), np.linspace(0.02, 0.6, 59))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = np.diff(edges)[:, None] / 2
    q, weights = (edges[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel()
    slabs = [(3000, 0.3, 10)] * 15 + [(200, 0.35, 10)] * 60 + [(40, 0.4, 10)] * 25
    xx, zz, _ = stress_waves(slabs, (40, 0.4), q).transpose(1, 0, 2)
    circle = -1.1 * weights * 150 * j1(150 * q)
    for depth, sigma_r, sigma_z in ELLEA1:
        k = depth // 10 - 1
        nu = slabs[k][1]
        found = (xx[k] + nu * (xx[k] + zz[k])) @ circle / 2, zz[k] @ circle
        np.testing.assert_allclose(found, (sigma_r, sigma_z), rtol=3e-4, atol=1e-4)


@pytest.mark.parametrize("poisson", [(0.3, 0.3), (0.0, 0.45), (0.5, 0.2)])
@pytest.mark.parametrize("ratio", [0.1, 0.5, 2.0, 4.0, 10.0, 100.0])
def test_stress_waves_agree_with_the_independent_solution(ratio, poisson):
    q, (nu, base_nu) = np.array([0.01, 0.1, 0.5, 0.9, 1.1, 2.0, 5.0]), poisson
    slabs = [(ratio, nu, 0.25)] * 4 + [(1.0, base_nu, 0.25)] * 3
    waves = LayerWaves(Layer(1.0, (ratio, 1.0), poisson), q)
    for k, (xx, zz, xz) in enumerate(stress_waves(slabs, (1.0, base_nu), q)):
        value, slope, curvature = waves.functions(0.25 * (k + 1))
        np.testing.assert_allclose(
            [curvature, -value, slope], [xx, zz, xz], rtol=0, atol=1e-11 * ratio + 1e-11
        )
