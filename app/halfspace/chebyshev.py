"""Chebyshev and Lagrange interpolation; step lengths of Chebyshev's iteration."""

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.fft import dctn


def chebyshev_nodes(count):
    """Return the `count` points in [0, 1] at which `fit_even_chebyshev` samples."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / (2 * count))


def even_chebyshev(t, count):
    """Return Chebyshev polynomials T_0, T_2, ... at points t, shape (*t.shape, count)."""
    return chebyshev.chebvander(2 * np.square(t) - 1, count - 1)  # T_2k(t) = T_k(2 t^2 - 1)


def fit_even_chebyshev(values):
    """Return the coefficients of a function f(s, t) in even Chebyshev polynomials.

    ``values[i, k]`` is f at node i of s and node k of t, both from `chebyshev_nodes`. The coefficient [m, n] belongs to
    T_2m(s) T_2n(t).
    """
    coefficients = dctn(values) / values.size
    coefficients[0] /= 2
    coefficients[:, 0] /= 2
    return coefficients


def lagrange_weights(at, places):
    """Return Lagrange's weights from `places` to `at`, shape (len(at), len(places))."""
    weights = []
    for k, place in enumerate(places):
        rest = np.delete(places, k)
        weights.append(np.prod((at[:, None] - rest) / (place - rest), axis=1))
    return np.stack(weights, axis=1)


@lru_cache(maxsize=64)
def chebyshev_steps(steps, low, high):
    """Return step lengths of Chebyshev's iteration, a read-only array.

    The `steps` step lengths are the reciprocals of the roots of a Chebyshev polynomial on the interval from `low` to
    `high`, which contains the eigenvalues of the matrix. The order of the roots keeps intermediate results small
    (Leja): the next root has the largest product of distances from the roots before it. The first step is the shortest.
    """
    roots = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (2 * np.arange(steps) + 1) / (2 * steps))
    order, half = [], (high - low) / 2 or 1.0
    for _ in range(steps):
        distances = np.prod(abs(roots[:, None] - roots[order]) / half, axis=1)
        order.append(int(np.argmax(distances)))
    lengths = 1 / roots[order]
    lengths.flags.writeable = False
    return lengths
