"""Influence coefficients against Love's closed form in 50 digits."""

from decimal import Decimal, localcontext
from math import comb

import numpy as np
import pytest

from app.halfspace import love as coefficients
from app.halfspace.grid import Grid
from app.halfspace.influence import Material, dense_matrix, influence_quadrant

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
def test_every_distance_and_aspect_ratio(aspect, tall):
    n = 20000
    dx, dy = (1.0, float(aspect)) if tall else (float(aspect), 1.0)
    along_x = influence_quadrant(Grid(n, 1, dx, dy), 1.0)[0]
    for k in interesting(n, aspect):
        along_y = influence_quadrant(Grid(1, n, dx, dy), 1.0, slice(k, k + 1))[0, 0]
        for value, i, j in ((along_x[k], k, 0), (along_y, 0, k)):
            far = np.hypot(i * dx, j * dy) >= 8 * aspect
            assert relative_error(value, i, j, dx, dy) <= (FAR if far else NEAR * aspect), (i, j)


@pytest.mark.parametrize(("dx", "dy"), [(1.0, 1.0), (0.7, 0.4), (0.4, 0.7), (3.0, 0.1), (0.03, 3.0)])
def test_off_the_axes(dx, dy):
    grid, longer = Grid(300, 200, dx, dy), max(dx, dy)
    quadrant = influence_quadrant(grid, 1.0)
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


def test_what_the_series_leaves_out_is_below_round_off():
    # The term of order 2n is the mean of s^2n P_2n(cos) / r^(2n+1) over the cell; |P_2n| <= 1, and s^2n is
    # largest on a square: s^2 = x^2 + y^2, |x|, |y| <= 1/2.
    def mean(n):
        return sum(comb(n, k) * 0.25**n / ((2 * k + 1) * (2 * (n - k) + 1)) for k in range(n + 1))

    first = coefficients._ORDER // 2 + 1
    assert (
        sum(mean(n) / coefficients._MAX_CLOSED_FORM_DISTANCE ** (2 * n) for n in range(first, first + 40))
        < 4e-17
    )


def test_own_displacement_of_a_square():
    # Love 1929: the centre of a square of side s under unit pressure moves by 4 s ln(1 + sqrt 2) compliance.
    value = influence_quadrant(Grid(1, 1, 0.3, 0.3), 2.0)[0, 0]
    assert value == pytest.approx(2.0 * 0.3 * 4 * np.log(1 + np.sqrt(2)), rel=1e-15)


def test_far_away_a_cell_is_a_point_force():
    # Boussinesq, with the next term of the expansion: (dx dy / r) (1 + O(cell^2 / r^2)).
    grid = Grid(4000, 1, 2.0, 3.0)
    r = grid.dx * np.arange(1000, 4000)
    ratio = influence_quadrant(grid, 1.0)[0, 1000:] * r / grid.cell_area
    np.testing.assert_allclose(ratio, 1 + (2 * 2.0**2 - 3.0**2) / (24 * r**2), rtol=0, atol=1e-12)


def test_exchange_of_x_and_y():
    wide = influence_quadrant(Grid(41, 23, 0.3, 1.1), 1.0)
    tall = influence_quadrant(Grid(23, 41, 1.1, 0.3), 1.0)
    np.testing.assert_allclose(wide, tall.T, rtol=4 * NEAR)


@pytest.mark.parametrize("scale", [2.0**-166, 0.125, 2.0, 2.0**166])
def test_scales_with_compliance_and_length(scale):
    quadrant = influence_quadrant(Grid(30, 20, 0.3, 0.5), 1.0)
    scaled = influence_quadrant(Grid(30, 20, 0.3 * scale, 0.5 * scale), 0.25)
    np.testing.assert_array_equal(scaled, 0.25 * scale * quadrant)


def test_nine_cells_make_one_of_three_times_the_size():
    fine, coarse = Grid(300, 300, 0.5, 0.35), Grid(100, 100, 1.5, 1.05)
    quadrant = np.pad(influence_quadrant(fine, 1.0), ((1, 0), (1, 0)), mode="reflect")  # offsets from -1
    nine = sum(quadrant[j::3, i::3][:100, :100] for j in range(3) for i in range(3))
    np.testing.assert_allclose(nine, influence_quadrant(coarse, 1.0), rtol=4 * NEAR)


def test_positive_and_decreasing():
    quadrant = influence_quadrant(Grid(300, 200, 0.7, 0.4), 1.0)
    assert (quadrant > 0).all()
    assert (np.diff(quadrant, axis=0) < 0).all()
    assert (np.diff(quadrant, axis=1) < 0).all()


def test_rows_and_columns_are_those_of_the_whole():
    grid = Grid(37, 50, 0.7, 0.4)
    whole = influence_quadrant(grid, 1.0)
    for rows in (slice(0, 1), slice(7, 23), slice(49, 50), slice(5, 5), slice(None, None, 3)):
        np.testing.assert_array_equal(influence_quadrant(grid, 1.0, rows), whole[rows])
        for columns in (0, 1, 8, 19, 37):
            some = influence_quadrant(grid, 1.0, rows, columns)
            np.testing.assert_array_equal(some, whole[rows, :columns])


@pytest.mark.parametrize("grid", [Grid(6, 5, 1.0, 1.0), Grid(1, 7, 2.0, 0.1), Grid(8, 3, 0.01, 5.0)])
def test_dense_matrix(grid):
    A = dense_matrix(grid, 1.3)
    quadrant = influence_quadrant(grid, 1.3)
    np.testing.assert_array_equal(A, A.T)
    assert np.linalg.eigvalsh(A).min() > 0
    for row in range(grid.n):
        for column in range(grid.n):
            (j, i), (l, k) = divmod(row, grid.nx), divmod(column, grid.nx)
            assert A[row, column] == quadrant[abs(j - l), abs(i - k)]


def test_material():
    # Steel on steel, Sec. 5.1: 2/G = 1/G1 + 1/G2, 1/E* = (1 - nu)/G
    steel = Material.combined(82000.0, 0.28)
    assert steel.compliance == pytest.approx(0.72 / (np.pi * 82000), rel=1e-15)
    assert steel.contact_modulus == pytest.approx(82000 / 0.72, rel=1e-15)
    assert steel.describe() == {
        "shear_modulus": 82000,
        "poisson_ratio": 0.28,
        "contact_modulus": steel.contact_modulus,
    }
    alike = Material.from_contact_modulus(steel.contact_modulus)
    assert alike.compliance == pytest.approx(steel.compliance, rel=1e-15)
    assert alike.describe() == {"contact_modulus": steel.contact_modulus}
    with pytest.raises(ValueError, match="contact modulus -1: must be positive"):
        Material.from_contact_modulus(-1.0)
    for poisson_ratio in (0, 0.5):
        Material.combined(1.0, poisson_ratio)


@pytest.mark.parametrize("shear_modulus", [0, -1.0, np.inf, np.nan, 1e-320])
def test_shear_modulus_must_be_positive_and_finite(shear_modulus):
    with pytest.raises(ValueError, match="shear modulus"):
        Material.combined(shear_modulus, 0.3)


@pytest.mark.parametrize("poisson_ratio", [-1e-9, 0.5 + 1e-9, np.nan, np.inf])
def test_poisson_ratio_must_be_from_0_to_one_half(poisson_ratio):
    with pytest.raises(ValueError, match="Poisson ratio"):
        Material.combined(1.0, poisson_ratio)
