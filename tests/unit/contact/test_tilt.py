"""Tilts, and sums over linear functions."""

import numpy as np

from app.contact.tilt import NO_TILT, Tilt, linear_sums


def test_a_tilt_adds_nothing_at_its_pivot():
    tilt = Tilt(0.1, -0.2, 3.0, 4.0)
    assert tilt.rise(3.0, 4.0) == 0
    assert tilt.rise(4.0, 6.0) == 0.1 - 0.4
    assert NO_TILT.rise(5.0, 6.0) == 0


def test_linear_sums_are_moments():
    rng = np.random.default_rng(1)
    field, x, y = rng.random((4, 6)), rng.random(6), rng.random(4)
    functions = np.broadcast_arrays(1.0, x, y[:, None], field)[:3]
    expected = [[(field * f * g).sum() for f in functions] for g in functions]
    np.testing.assert_allclose(linear_sums(field, x, y), expected)
