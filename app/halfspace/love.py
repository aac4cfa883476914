"""Displacement by a uniform pressure on one cell (paper, eq. (2.4)).

Love's closed form is used near the cell, a Taylor series farther away.
"""

import math
from fractions import Fraction
from functools import lru_cache

import numpy as np

from app.base.numba_cache import njit
from app.halfspace import events

# The closed form subtracts numbers up to rho/cell times larger than their difference. From 8 cells on, a Taylor series
# about the centre of the cell has no cancellation; its terms beyond order 12 sum up to less than 4e-17.
_MAX_CLOSED_FORM_DISTANCE = 8.0
_ORDER = 12


@lru_cache(maxsize=64)
def _taylor_series(dx, dy):
    """Return the Taylor series of a cell's mean 1/rho, far away.

    The mean of 1/rho over a cell with its centre at (x, y) is ``sum_nk c[n, k] y^2k r^-(2n+2k+1)``. Here rho is the
    distance of a point in the cell from the origin, and ``r^2 = x^2 + y^2``. Row n of c has the terms of order 2n. (dx,
    dy) is the size of the cell. Lengths are in units of its longer side. Return the two sides, their squares (correctly
    rounded), and the coefficients c.
    """
    sides = [Fraction(side) / Fraction(max(dx, dy)) for side in (dx, dy)]
    n, k = np.indices((_ORDER // 2 + 1,) * 2)
    s = 2 * (n + k) + 1
    # The second derivative of y^2k r^-s in x, and in y: factors of y^(2k+2q) r^-(s+2+2q), q = -1, 0, 1.
    in_x = 0 * s, s * (s + 1), -s * (s + 2)
    in_y = 2 * k * (2 * k - 1), -s * (4 * k + 1), s * (s + 2)
    mean = np.zeros(s.shape)
    mean[0, 0] = 1
    for side, (before, same, after) in zip(sides, (in_x, in_y), strict=True):
        term = mean
        for p in range(1, len(mean)):
            derivative = np.zeros(s.shape)
            derivative[1:, :-1] = (before * term)[:-1, 1:]
            derivative[1:] += (same * term)[:-1]
            derivative[1:, 1:] += (after * term)[:-1, :-1]
            term = derivative * float(side**2 / (8 * p * (2 * p + 1)))
            mean = mean + term
    return tuple(map(float, sides)), tuple(float(side**2) for side in sides), mean


@njit()
def _edge(distance, i, length):
    """Return the integral of 1/rho along an edge.

    rho is the distance from the origin. The edge has the given `length`. The edge lies on a line at `distance` from the
    origin, from ``(i - 1/2) length`` to ``(i + 1/2) length``.
    """
    low, high = (i - 0.5) * length, (i + 0.5) * length
    if i == 0:
        return 2 * math.asinh(high / abs(distance))
    r_low, r_high = math.sqrt(distance**2 + low**2), math.sqrt(distance**2 + high**2)
    return math.log1p(length * (1 + 2 * i * length / (r_low + r_high)) / (low + r_low))


@njit(makes_arrays=True, error_model="numpy", fastmath={"contract"})
def _fill(quadrant, offsets, first, sides, squares, series, near, far):
    """Compute rows of the quadrant of influence coefficients, from the offset `first` in x on.

    A coefficient is `near` times the integral of 1/rho over the cell, or, far away, `far` times the mean of 1/rho. The
    integral over the cell is a sum over its edges: signed distance times integral of 1/rho along the edge, because
    1/rho = div(r / rho) with the vector r of length rho.
    """
    columns = quadrant.shape[1]
    dx, dy = sides
    x_squared = squares[0] * np.arange(first, first + columns) ** 2
    coefficients = np.empty(_ORDER + 1)
    for index in range(len(offsets)):
        j, row = offsets[index], quadrant[index]
        y_squared = squares[1] * j**2
        south, north = (j - 0.5) * dy, (j + 0.5) * dy
        x = (first - 0.5) * dx
        west = x * _edge(abs(x), j, dy)
        i = 0
        while i < columns and x_squared[i] + y_squared < _MAX_CLOSED_FORM_DISTANCE**2:
            x = (first + i + 0.5) * dx
            east = x * _edge(x, j, dy)
            # (2.4)
            row[i] = near * (
                east - west + north * _edge(north, first + i, dx) - south * _edge(south, first + i, dx)
            )
            west = east
            i += 1
        # Along a row the series is a polynomial of 1/r^2.
        coefficients[:] = 0
        for n in range(len(series)):
            y_power = far
            for k in range(n + 1):
                coefficients[n + k] += series[n, k] * y_power
                y_power *= y_squared
        x_rest, rest = x_squared[i:], row[i:]
        for m in range(len(rest)):
            inverse = 1 / math.sqrt(x_rest[m] + y_squared)
            total = coefficients[_ORDER]
            for n in range(_ORDER - 1, -1, -1):
                total = total * (inverse * inverse) + coefficients[n]
            rest[m] = total * inverse


def love_coefficients(cell, compliance, rows, columns):
    """Return influence coefficients of an elastic half-space (not periodic).

    `cell` is the size (dx, dy) of a cell [mm], `compliance` is (1 - nu) / (pi G) [mm2/N]. `rows` is an array of offsets
    in y, `columns` one of offsets in x, or their number from 0 on. The shape is (rows, columns), the unit mm / (N/mm2).
    """
    columns = np.arange(columns) if np.ndim(columns) == 0 else columns
    first, last = (int(columns.min()), int(columns.max())) if len(columns) else (0, -1)
    quadrant = np.empty((len(rows), last + 1 - first))
    sides, squares, series = _taylor_series(*cell)
    near, far = float(compliance * max(cell)), float(compliance * min(cell))  # (2.5)
    with events.coeffs:
        _fill(quadrant, rows, first, sides, squares, series, near, far)
    places = columns - first
    return quadrant if np.array_equal(places, np.arange(quadrant.shape[1])) else quadrant[:, places]
