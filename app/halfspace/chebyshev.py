"""Chebyshev and Lagrange interpolation, and Chebyshev step lengths of iterations."""

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev


def chebyshev_nodes(count):
    """Return the `count` nodes in [0, 1] that `fit_even_chebyshev` needs."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / (2 * count))


def even_chebyshev(t, count):
    """Return values of the first even Chebyshev polynomials at t.

    The shape is (*t.shape, count).
    """
    return chebyshev.chebvander(2 * np.square(t) - 1, count - 1)  # T_2k(t) = T_k(2 t^2 - 1)


def fit_even_chebyshev(values):
    """Return even Chebyshev coefficients of a function of two variables.

    `values` are those of the function at all pairs of `chebyshev_nodes` of the two axes.
    """
    first, second = (
        even_chebyshev(chebyshev_nodes(n), n).T * np.where(np.arange(n) > 0, 2.0, 1.0)[:, None] / n
        for n in values.shape
    )
    return first @ values @ second.T


def lagrange_weights(at, places):
    """Return the weights that interpolate values at `places` to points `at`.

    They are Lagrange's, shape (len(at), len(places)).
    """
    weights = []
    for k, place in enumerate(places):
        rest = np.delete(places, k)
        weights.append(np.prod((at[:, None] - rest) / (place - rest), axis=1))
    return np.stack(weights, axis=1)


@lru_cache(maxsize=64)
def chebyshev_steps(steps, low, high):
    """Return step lengths of Chebyshev's iteration, a read-only array.

    The steps are the reciprocals of Chebyshev's roots for a matrix with eigenvalues from `low` to `high`. Leja's order
    of the roots keeps intermediate results small: the next root has the largest product of distances from the roots
    before. The first step is the shortest.
    """
    roots = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (2 * np.arange(steps) + 1) / (2 * steps))
    order, half = [], (high - low) / 2 or 1.0
    for _ in range(steps):
        distances = np.prod(abs(roots[:, None] - roots[order]) / half, axis=1)
        order.append(int(np.argmax(distances)))
    lengths = 1 / roots[order]
    lengths.flags.writeable = False
    return lengths
