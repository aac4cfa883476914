"""Periodic patches: influence coefficients, transfers, and the certificate."""

import tracemalloc
from unittest import mock

import numpy as np
import periodic
import pytest
import scipy.fft
import scipy.special
from operators import DOUBLE, PERIODIC, STEEL, matrix_of, random_field

from app import ContactSolver
from app.base.errors import InputError
from app.halfspace import influence
from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.operator import InfluenceOperator
from app.halfspace.periodic_symbol import influence_symbol

each_grid = pytest.mark.parametrize("grid", PERIODIC.values(), ids=PERIODIC.keys())


@each_grid
def test_the_matrix_is_symmetric_positive_on_zero_sum_pressures_and_displaces_nothing_on_average(grid):
    matrix = matrix_of(grid)
    values = np.linalg.eigvalsh(matrix)
    assert (matrix == matrix.T).all()
    assert abs(matrix.sum(axis=0)).max() <= 1e-14 * grid.n * values[-1]
    assert abs(values[0]) <= 1e-14 * values[-1] < 1e-3 * values[1]


@each_grid
def test_waves_are_its_eigenvectors(grid):
    quadrant = influence_quadrant(grid, STEEL)
    symbol = influence_symbol(grid, STEEL, np.arange(grid.nx // 2 + 1), np.arange(grid.ny // 2 + 1))
    spectrum = scipy.fft.rfft2(quadrant)[: grid.ny // 2 + 1].T
    np.testing.assert_allclose(spectrum, symbol, rtol=0, atol=1e-13 * symbol.max())


@each_grid
def test_translation_by_whole_cells_changes_nothing(grid):
    operator, p = InfluenceOperator(grid, STEEL), random_field(grid, 1)
    u, moved = np.empty(grid.shape), np.empty(grid.shape)
    operator.displacement(p, u)
    operator.displacement(np.roll(p, (3, 5), (0, 1)), moved)
    np.testing.assert_allclose(moved, np.roll(u, (3, 5), (0, 1)), rtol=0, atol=DOUBLE * abs(u).max())
    assert abs(u.mean()) <= DOUBLE * abs(u).max()


@each_grid
def test_the_inverse_is_one_but_for_the_mean(grid):
    operator, p = InfluenceOperator(grid, STEEL), random_field(grid, 2)
    u, back = np.empty(grid.shape), np.empty(grid.shape)
    operator.exact_displacement(p, u)
    operator.exact_inverse.apply(u, back)
    np.testing.assert_allclose(back, p - p.mean(), rtol=0, atol=1e-13 * abs(p).max())
    assert operator.exact_inverse.norm() * np.linalg.eigvalsh(matrix_of(grid))[1] == pytest.approx(
        1, rel=1e-10
    )
    assert operator.diagonal == pytest.approx(matrix_of(grid)[0, 0], rel=1e-14)


@each_grid
@pytest.mark.parametrize("stiffness", [1e-3, 1.0, 1e3])
def test_springs_hold_constants_and_long_waves(grid, stiffness):
    """(B + stiffness) u = p, also for the mean of p, which without springs displaces nothing."""
    operator, p = InfluenceOperator(grid, STEEL), 1 + random_field(grid, 2)
    stiffness /= operator.diagonal
    screened, u, back = operator.screened_product, np.empty(grid.shape), np.empty(grid.shape)
    for value in (7 * stiffness, stiffness):
        screened.screen(value)
    screened.apply(p, u)
    operator.exact_inverse.apply(u, back)
    np.testing.assert_allclose(back + stiffness * u, p, rtol=0, atol=1e-12 * abs(p).max())


@pytest.mark.parametrize("cells", [3, 101, 1001])
def test_a_long_cell_displaces_as_the_square_cells_that_it_consists_of(cells):
    long, square = Grid(64, 2, 1.0, cells, periodic="love"), Grid(64, 2 * cells, 1.0, 1.0, periodic="love")
    whole, parts = (influence_quadrant(grid, 1.0) for grid in (long, square))
    offsets = np.arange(2)[:, None] * cells + np.arange(cells) - cells // 2
    np.testing.assert_allclose(whole, parts[offsets].sum(axis=1), rtol=0, atol=1e-13 * whole.max())
    turned = influence_quadrant(Grid(2, 64, cells, 1.0, periodic="love"), 1.0)
    np.testing.assert_allclose(turned, whole.T, rtol=0, atol=1e-14 * whole.max())


def test_the_symbol_of_long_cells_takes_little_more_memory_than_that_of_square_ones():
    """Though the images near by are as many as a cell is long."""
    columns, rows = np.arange(64), np.arange(2)
    peaks = {}
    for aspect in (1.0, 1e5):
        grid = Grid(128, 2, 1.0, aspect, periodic="love")
        influence_symbol(grid, 1.0, columns[:1], rows[:1])  # load what is loaded once
        tracemalloc.start()
        influence_symbol(grid, 1.0, columns, rows)
        peaks[aspect] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peaks[1e5] < 10 * peaks[1.0]  # by a logarithm


@pytest.mark.parametrize(("nx", "ny", "dx", "dy"), [(8, 6, 0.5, 0.5), (5, 6, 0.3, 0.4), (50, 2, 0.02, 0.5)])
def test_love_is_the_sum_over_all_images(nx, ny, dx, dy):
    """The sum over images up to R, its mean taken off, lacks a / R + b / R^3: three of them leave next to nothing."""
    grid = Grid(nx, ny, dx, dy, periodic="love")

    def summed(most):
        whole = influence_quadrant(Grid((most + 1) * nx, (most + 1) * ny, dx, dy), 1.0)
        j, i = (np.abs(np.arange(n)[:, None] + n * np.arange(-most, most + 1)) for n in (ny, nx))
        share = np.where(abs(np.arange(-most, most + 1)) == most, 0.5, 1.0)  # of images at the rim
        total = np.einsum("yaxb,a,b->yx", whole[j][:, :, i], share, share)
        return total - total.mean()

    one, two, four = (summed(most) for most in (8, 16, 32))
    first = 2 * two - one, 2 * four - two
    found = influence_quadrant(grid, 1.0)
    errors = [
        abs(sums - found).max() / found[0, 0] for sums in (four, first[1], (8 * first[1] - first[0]) / 7)
    ]
    assert errors[-1] < 1e-6 and errors[1] < 0.1 * errors[0] and errors[2] < 0.1 * errors[1], errors


@pytest.mark.parametrize(("n", "step"), [(8, 1e-5), (13, 0.7), (200, 0.1), (1, 2.0)])
def test_love_on_strips_is_the_closed_sum_of_waves_across(n, step):
    """However many cells a strip is cut into, and whichever way it lies."""
    whole = np.arange(n // 2 + 1)
    part = np.append(0.5, whole[1:] / n)  # of a wave from strip to strip; the first one has none
    ends, middle = (
        scipy.special.zeta(2, one) + scipy.special.zeta(2, other)
        for one, other in ((part / 2, (1 - part) / 2), ((1 + part) / 2, 1 - part / 2))
    )
    closed = 2 * np.pi * step * np.sin(np.pi * part) * (ends - middle) / (8 * np.pi**2)
    closed[0] = 0.0
    for nx in (1, 4):
        strips = influence_symbol(Grid(nx, n, 3.0 / nx, step, periodic="love"), 1.0, [0], whole)
        np.testing.assert_allclose(strips, closed[None], rtol=1e-13)
    turned = influence_symbol(Grid(n, 1, step, 3.0, periodic="love"), 1.0, whole, [0])
    np.testing.assert_allclose(turned, strips.T, rtol=1e-14)


def test_the_kernel_of_a_sweep_is_computed_once():
    operator = InfluenceOperator(Grid(64, 200, 1.0, 1.0, periodic="spectral"), 1.0)
    with mock.patch.object(influence, "periodic_quadrant", wraps=influence.periodic_quadrant) as compute:
        assert operator.relaxation is operator.relaxation
        assert operator.diagonal > 0
    assert compute.call_count == 1


@pytest.mark.parametrize(("nx", "ny"), [(12, 8), (9, 8), (12, 7), (31, 3), (5, 1)])
def test_a_coarser_grid_has_the_same_period_and_its_cells_lie_amid_their_children(nx, ny):
    grid = Grid(nx, ny, 0.3, 2.0, 5.0, -1.0, "spectral")
    coarse = grid.coarsen(1)
    assert coarse.area == pytest.approx(grid.area)
    for axis, (a, b) in zip("yx", grid.places_in(coarse), strict=True):
        n, d = getattr(grid, f"n{axis}"), getattr(grid, f"d{axis}")
        of, wide = getattr(coarse, axis)(), getattr(coarse, f"d{axis}")
        fine = getattr(grid, axis)()
        np.testing.assert_allclose(of[0] + wide * (a * np.arange(n) + b), fine, rtol=0, atol=1e-12 * n * d)
        children = [fine[2 * j : 2 * j + 2].mean() for j in range(len(of))] if n > 1 else fine
        assert abs(of - children).max() <= 0.5 * d * (n % 2) + 1e-12 * n * d


@pytest.mark.parametrize(
    ("method", "options", "match"),
    [
        ("fmg_v11", {"pc_mg_levels": "9"}, r"-pc_mg_levels 9: this grid allows 1 to 3"),
        (
            None,
            {"lcp_type": "fast"},
            r"-lcp_type fast: .*allowed on periodic ones: .*primal, active_set, tao, snesvi",
        ),
    ],
)
def test_what_cannot_be_done_is_said(method, options, match):
    with pytest.raises(InputError, match=match):
        ContactSolver(periodic.rough(9, 7, 1), method, options)


def test_the_energy_is_that_of_the_cells_there_are():
    """In step 4.a cells leave, and no solver has been told yet."""
    operator = InfluenceOperator(Grid(12, 10, 1.0, 1.0, periodic="love"), 1.0)
    operator.mask[...] = False
    operator.mask[2:6, 2:6] = True
    operator.mask_changed()
    before = operator.energy_of_contact()
    operator.mask[2] = False
    energy, cells = operator.energy_of_contact()
    p, u = operator.mask.astype(float), np.empty(operator.local_shape)
    operator.displacement(p, u)
    assert (energy, cells) == (np.vdot(p, u), 12) != before
