"""Influence coefficients against Love's closed form in 50 digits."""

from decimal import Decimal, localcontext
from math import comb

import numpy as np
import pytest

from app.halfspace import love as coefficients
from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.kernel import UNIT

# Closed form up to 8 cells: it cancels (distance / shorter side) of its digits. Measured: below 5e-15 times the
# aspect ratio. Beyond, a Taylor series that cancels nothing: 3.5e-16.
NEAR, FAR = 5e-15, 6e-16


def asinh(x):
    return ((abs(x) + (x * x + 1).sqrt()).ln()).copy_sign(x)


def love(a, b):
    return a * asinh(b / abs(a)) + b * asinh(a / abs(b))


def exact(i, j, dx, dy):
    """Integral of 1/rho over a cell, i and j cells away."""
    with localcontext() as context:
        context.prec = 50
        dx, dy = Decimal(dx), Decimal(dy)
        west, east = (i - Decimal("0.5")) * dx, (i + Decimal("0.5")) * dx
        south, north = (j - Decimal("0.5")) * dy, (j + Decimal("0.5")) * dy
        return love(east, north) - love(west, north) - love(east, south) + love(west, south)


def relative_error(value, i, j, dx, dy):
    with localcontext() as context:
        context.prec = 50
        return abs(float(Decimal(float(value)) / exact(i, j, dx, dy) - 1))


def interesting(n, aspect):
    """Offsets up to n: all small ones, both sides of the change of rule, and some in between."""
    changes = np.array([8, np.ceil(8 * aspect)])
    offsets = np.concatenate(
        [range(9), changes - 1, changes, changes + 1, np.geomspace(9, n - 1, 12).astype(int)]
    )
    return [int(k) for k in np.unique(offsets) if k < n]


@pytest.mark.parametrize("aspect", [1, 1.7, 10, 100, 1000])
@pytest.mark.parametrize("tall", [False, True])
def test_coefficients_along_axes_are_exact(aspect, tall):
    n = 20000
    dx, dy = (1.0, float(aspect)) if tall else (float(aspect), 1.0)
    along_x = influence_quadrant(Grid(n, 1, dx, dy), UNIT)[0]
    for k in interesting(n, aspect):
        along_y = influence_quadrant(Grid(1, n, dx, dy), UNIT, slice(k, k + 1))[0, 0]
        for value, i, j in ((along_x[k], k, 0), (along_y, 0, k)):
            far = np.hypot(i * dx, j * dy) >= 8 * aspect
            assert relative_error(value, i, j, dx, dy) <= (FAR if far else NEAR * aspect), (i, j)


@pytest.mark.parametrize(("dx", "dy"), [(1.0, 1.0), (0.7, 0.4), (0.4, 0.7), (3.0, 0.1), (0.03, 3.0)])
def test_coefficients_off_axes_are_exact(dx, dy):
    grid, longer = Grid(300, 200, dx, dy), max(dx, dy)
    quadrant = influence_quadrant(grid, UNIT)
    rng = np.random.default_rng(1)
    angle = rng.uniform(0, np.pi / 2, 60)
    seam = np.array([np.cos(angle) / dx, np.sin(angle) / dy]) * 8 * longer + rng.integers(0, 2, (2, 60))
    offsets = [
        *rng.integers(0, [20, 20], (40, 2)),
        *rng.integers(0, [300, 200], (80, 2)),
        *seam.T.astype(int),
    ]
    for i, j in offsets:
        if i >= grid.nx or j >= grid.ny:
            continue
        far = np.hypot(i * dx, j * dy) >= 8 * longer
        error = relative_error(quadrant[j, i], int(i), int(j), dx, dy)
        assert error <= (FAR if far else NEAR * longer / min(dx, dy)), (i, j)


def test_truncation_of_series_is_below_round_off():
    # The term of order 2n is the mean of s^2n P_2n(cos) / r^(2n+1) over the cell; |P_2n| <= 1, and s^2n is
    # largest on a square: s^2 = x^2 + y^2, |x|, |y| <= 1/2.
    def mean(n):
        return sum(comb(n, k) * 0.25**n / ((2 * k + 1) * (2 * (n - k) + 1)) for k in range(n + 1))

    first = coefficients._ORDER // 2 + 1
    assert (
        sum(mean(n) / coefficients._MAX_CLOSED_FORM_DISTANCE ** (2 * n) for n in range(first, first + 40))
        < 4e-17
    )
