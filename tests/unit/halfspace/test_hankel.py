"""Hankel, cosine and sine transforms against closed forms."""

import numpy as np
import pytest

from app.halfspace.hankel import HankelRule

R = np.concatenate([[0.0], np.geomspace(1e-4, 9.9, 40), np.geomspace(10.1, 1e6, 40)])


@pytest.mark.parametrize("decay", [1.0, 2.0, 30.0, 1e4])
def test_transforms_of_decaying_functions_are_exact(decay):
    rule = HankelRule(R)
    near, far = np.exp(-decay * rule.near), np.exp(-decay * rule.far)
    distance = np.hypot(R, decay)
    np.testing.assert_allclose(rule.transform(near, far, "J0"), 1 / distance, atol=1e-11)
    slope = rule.transform(near, far, "J1")  # (1 - decay / distance) / r^2
    np.testing.assert_allclose(slope, 1 / (distance * (distance + decay)), atol=1e-11)
    np.testing.assert_allclose(slope * R**2, 1 - decay / distance, atol=1e-10)
    np.testing.assert_allclose(rule.transform(near, far, "cos"), decay / distance**2, atol=1e-9)
    over_distance = np.divide(np.arctan(R / decay), R, out=np.full_like(R, 1 / decay), where=R > 0)
    np.testing.assert_allclose(rule.transform(near, far, "sin"), over_distance, atol=1e-11)
