"""Chebyshev and Lagrange interpolation, and step lengths."""

import numpy as np
import pytest

from app.halfspace.chebyshev import (
    chebyshev_nodes,
    chebyshev_steps,
    even_chebyshev,
    fit_even_chebyshev,
    lagrange_weights,
)


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 10, 51])
def test_order_of_chebyshev_steps_amplifies_nothing(steps):
    low, high = 0.5, 1.4
    lengths, waves = chebyshev_steps(steps, low, high), np.linspace(low, high, 500)
    factors = 1 - lengths[:, None] * waves
    assert lengths.shape == (steps,)
    assert (abs(np.cumprod(factors, axis=0)) <= 1).all()
    least = 1 / np.cosh(steps * np.arccosh((high + low) / (high - low)))  # of Chebyshev's polynomial
    assert abs(np.prod(factors, axis=0)).max() <= least * (1 + 1e-9)


def test_even_polynomials_are_fitted_exactly():
    """In both axes, of a degree below twice the number of nodes."""

    def f(x, y):
        return 1 + 2 * x**4 - 3 * y**2 + x**2 * y**4

    coefficients = fit_even_chebyshev(f(chebyshev_nodes(3)[:, None], chebyshev_nodes(4)))
    x, y = np.linspace(-1, 1, 7), np.linspace(0, 1, 5)
    fitted = even_chebyshev(x, 3) @ coefficients @ even_chebyshev(y, 4).T
    np.testing.assert_allclose(fitted, f(x[:, None], y), rtol=0, atol=1e-13)


def test_lagrange_weights_are_exact_for_polynomials():
    places, at = np.array([-1.0, 0.5, 2.0, 3.0]), np.array([-0.3, 0.5, 2.4])
    weights = lagrange_weights(at, places)
    for power in range(4):
        np.testing.assert_allclose(weights @ places**power, at**power, rtol=0, atol=1e-13)
