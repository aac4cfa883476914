"""Interpolation by polynomials: Chebyshev's, of smooth even functions on [0, 1], Lagrange's; steps of iterations."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev


def chebyshev_nodes(count):
    """Places where a function must be known to be interpolated by so many polynomials. Not collective."""
    return np.cos(np.pi * (np.arange(count) + 0.5) / (2 * count))


def even_chebyshev(t, count):
    """Values of the first even polynomials, shape (*t.shape, count). Not collective."""
    return chebyshev.chebvander(2 * np.square(t) - 1, count - 1)  # T_2k(t) = T_k(2 t^2 - 1)


def fit_even_chebyshev(values):
    """Coefficients of the polynomials from values in the nodes, both axes. Not collective."""
    first, second = (
        even_chebyshev(chebyshev_nodes(n), n).T * np.where(np.arange(n) > 0, 2.0, 1.0)[:, None] / n
        for n in values.shape
    )
    return first @ values @ second.T


def lagrange_weights(at, places):
    """Weights of the values in some places for the polynomial through them, shape (len(at), len(places)).

    Not collective.
    """
    weights = []
    for k, place in enumerate(places):
        rest = np.delete(places, k)
        weights.append(np.prod((at[:, None] - rest) / (place - rest), axis=1))
    return np.stack(weights, axis=1)


@lru_cache(maxsize=64)
def chebyshev_steps(steps, low, high):
    """Lengths of the steps of Richardson's iteration that is best on eigenvalues between `low` and `high`.

    Not collective; the array is to be read only. In an order by which nothing grows meanwhile, as Leja's: the next one
    belongs to the eigenvalue that is farthest, by the product of distances, from those before. The first one is the
    shortest.
    """
    roots = (low + high) / 2 + (high - low) / 2 * np.cos(np.pi * (2 * np.arange(steps) + 1) / (2 * steps))
    order, half = [], (high - low) / 2 or 1.0
    for _ in range(steps):
        far = np.prod(abs(roots[:, None] - roots[order]) / half, axis=1)
        order.append(int(np.argmax(far)))
    lengths = 1 / roots[order]
    lengths.flags.writeable = False
    return lengths
