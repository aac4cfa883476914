"""Periodic patches: influence coefficients, transfers, and the certificate."""

import tracemalloc
from fractions import Fraction
from unittest import mock

import numpy as np
import periodic
import pytest
import scipy.fft
import scipy.special
from mpi4py import MPI
from operators import DOUBLE, PERIODIC, STEEL, matrix_of, random_field

from app import ContactProblem, ContactSolver, Material
from app.base.errors import InputError
from app.contact.certificate import certify, estimate
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.halfspace import influence
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix, influence_quadrant
from app.halfspace.operator import InfluenceOperator
from app.halfspace.periodic_symbol import influence_symbol
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.transfer import Transfer
from app.verification.dense import DenseProblem

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


def test_odd_grids_are_halved_too():
    shapes = [
        [
            level.grid.shape
            for level in Hierarchy(Grid(nx, ny, 1.0, 1.0, periodic="spectral"), 1.0, MPI.COMM_SELF).levels
        ]
        for nx, ny in ((24, 40), (36, 7), (15, 7), (4, 4))
    ]
    assert shapes == [
        [(3, 3), (5, 3), (10, 6), (20, 12), (40, 24)],
        [(4, 3), (4, 5), (4, 9), (4, 18), (7, 36)],
        [(4, 4), (4, 8), (7, 15)],
        [(2, 2), (4, 4)],
    ]


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


@pytest.mark.parametrize("shape", [(31, 22), (46, 31), (33, 33)])
def test_long_waves_survive_the_way_to_an_odd_grid_and_back(shape):
    ny, nx = shape
    fine = Grid(nx, ny, 1 / nx, 1 / ny, periodic="spectral")
    coarse = fine.coarsen()
    transfer = Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), (2, 2))

    def wave(grid):
        return np.cos(2 * np.pi * grid.x() + 1)[None, :] + np.sin(2 * np.pi * grid.y() + 2)[:, None]

    restricted, found = transfer.restrict_shape(wave(fine)), np.empty(shape)
    off = np.pi * (1 / nx + 1 / ny)  # half a fine cell
    np.testing.assert_allclose(restricted, wave(coarse), rtol=0, atol=off + 0.02)
    transfer.interpolate(wave(coarse), found)
    np.testing.assert_allclose(found, wave(fine), rtol=0, atol=0.1)  # between centres, there is no such error
    assert transfer.restrict_defect(found).sum() == pytest.approx(found.sum() / 4)  # nothing is lost


INTERPOLATIONS = "interpolate", "interpolate_quintic"


@pytest.mark.parametrize("interpolate", INTERPOLATIONS)
@pytest.mark.parametrize(("shape", "factors"), [((8, 6), (2, 2)), ((7, 12), (1, 2)), ((4, 2), (2, 2))])
def test_interpolation_does_not_know_where_the_patch_begins(shape, factors, interpolate):
    (ny, nx), (fy, fx) = shape, factors
    fine = Grid(nx, ny, 0.5, 0.5, periodic="spectral")
    coarse = Grid(nx // fx, ny // fy, 0.5 * fx, 0.5 * fy, periodic="spectral")
    transfer = Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), factors)
    u, found, moved = random_field(coarse, 1), np.empty(shape), np.empty(shape)
    getattr(transfer, interpolate)(u, found)
    getattr(transfer, interpolate)(np.roll(u, (1, 1), (0, 1)), moved)
    np.testing.assert_array_equal(moved, np.roll(found, factors, (0, 1)))
    assert found.mean() == pytest.approx(u.mean(), abs=1e-14)


@pytest.mark.parametrize("interpolate", INTERPOLATIONS)
@pytest.mark.parametrize(("nx", "ny"), [(9, 7), (5, 6), (6, 1), (2, 3)])
def test_constants_stay_where_a_period_cannot_be_halved_or_has_few_cells(nx, ny, interpolate):
    fine = Grid(nx, ny, 0.5, 0.3, periodic="love")
    coarse = fine.coarsen(1)
    transfer = Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), fine.coarsening(1))
    found = np.empty(fine.shape)
    getattr(transfer, interpolate)(np.full(coarse.shape, 3.0), found)
    np.testing.assert_allclose(found, 3.0, rtol=1e-14)


@pytest.mark.parametrize(("interpolate", "order"), zip(INTERPOLATIONS, (2, 6), strict=True))
@pytest.mark.parametrize("odd", [0, 1])
def test_order_of_interpolation_over_a_period(interpolate, order, odd):
    errors, cells = [], (64 + odd, 128 + odd)
    for n in cells:
        fine = Grid(n, n, 1 / n, 1 / n, periodic="spectral")
        coarse = fine.coarsen()

        def function(grid):
            return np.exp(np.sin(2 * np.pi * grid.x()))[None, :] * np.cos(2 * np.pi * grid.y() + 1)[:, None]

        transfer = Transfer(InfluenceOperator(fine, 1.0), InfluenceOperator(coarse, 1.0), (2, 2))
        found = np.empty(fine.shape)
        getattr(transfer, interpolate)(function(coarse), found)
        errors.append(abs(found - function(fine)).max())
    assert np.log(errors[0] / errors[1]) / np.log(cells[1] / cells[0]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("seed", range(4))
def test_certificate_bounds_the_error_of_any_pressure(seed, holes):
    """For the approach, and for the load that the exact solution has, if the pressure has it, too."""
    problem, approach = periodic.rough(9, 8, seed, holes), (0.5, 0.9, 0.99)[seed % 3]
    approach *= np.nanmean(problem.gap)
    exact, matrix = periodic.by_pivoting(problem, approach)
    rng = np.random.default_rng(seed)
    for size in (1e-9, 1e-6, 1e-3, 0.1, 10.0):
        p = np.maximum(exact + size * exact.max() * rng.normal(size=exact.shape) * (exact > 0), 0)
        p[rng.random(exact.shape) < 0.02] *= 1 - size / 10
        for factor in (1.0, exact.sum() / p.sum()):
            found = certified(problem, approach, p * factor)
            error = (p * factor - exact).ravel()
            true = np.sqrt(error @ matrix @ error / ((p * factor).ravel() @ matrix @ (p * factor).ravel()))
            assert true * (1 - 1e-6) - 1e-7 <= found.error_bound < np.inf
            if size <= 1e-6:
                assert found.error_bound <= 10 * true + 1e-6


def certified(problem, approach, p):
    return certify(pressed(problem, approach, p))


def pressed(problem, approach, p):
    operator = InfluenceOperator(problem.grid, problem.material.compliance)
    state = contact_state(operator, UndeformedDistance(operator, problem.gap))
    state.approach = approach
    state.pressure.setArray(p.ravel())
    state.compute_displacement()
    return state


@pytest.mark.parametrize("seed", range(3))
def test_a_bound_that_is_small_enough_costs_no_product(seed, monkeypatch):
    problem = periodic.rough(9, 8, seed)
    approach = 0.9 * problem.gap.mean()
    exact, _ = periodic.by_pivoting(problem, approach)
    p = exact * (1 + 1e-7 * np.random.default_rng(seed).normal(size=exact.shape))
    applied, plain = [], EvenMultiplier.apply
    monkeypatch.setattr(
        EvenMultiplier, "apply", lambda *given, **named: (applied.append(0), plain(*given, **named))[1]
    )
    bounds = []
    for wanted, products in ((np.inf, 0), (1e-5, 0), (1e-9, 1)):
        state = pressed(problem, approach, p)
        applied.clear()
        bounds.append(estimate(state, wanted).error_bound)
        assert len(applied) == products
    assert bounds[0] == bounds[1] > bounds[2]


@pytest.mark.parametrize("depth", [1e-3, 1e-10, 1e-16, 1e-25])
@pytest.mark.parametrize("share", [1 - 1e-3, 1 + 1e-6, 1.1])
def test_the_certificate_is_as_sharp_at_first_touch_as_elsewhere(depth, share):
    """Sums of gaps, larger than those of contact by many decades, have no part in the bound."""
    gap = np.random.default_rng(0).random((10, 12))
    gap[[2, 2, 7], [3, 4, 9]] = 0.0
    problem = ContactProblem(Grid(12, 10, 0.1, 0.1), Material.from_contact_modulus(1e5), gap, periodic="love")
    dense = DenseProblem(problem)
    exact = dense.at(depth).astype(float)
    bound = certified(problem, depth, share * exact).error_bound
    assert 0.5 * bound < abs(share - 1) / share <= bound


@pytest.mark.parametrize(
    ("shape", "symbol", "share"),
    [((3, 5), "spectral", 0.1), ((3, 6), "love", 0.5), ((4, 4), "spectral", 0.1)],
)
def test_the_certificate_counts_the_rounding_of_a_stored_matrix(shape, symbol, share):
    """Coefficients of long cells are much larger than the eigenvalues of the waves across them."""
    ny, nx = shape
    gap = np.tile(np.cos(2 * np.pi * np.arange(nx) / nx + 1), (ny, 1))
    problem = ContactProblem(Grid(nx, ny, 1.0, 1e4), periodic.MATERIAL, gap, periodic=symbol)
    dense, approach = DenseProblem(problem), (1 - share) * gap.min() + share * gap.mean()
    exact = dense.at(approach)
    p, contact = np.zeros(problem.grid.n), (exact > 0).ravel()
    rounded = dense_matrix(problem.grid, problem.material.compliance)[np.ix_(contact, contact)]
    p[contact] = np.linalg.solve(rounded, approach - gap.ravel()[contact])
    p = p.reshape(shape)
    bound = certified(problem, approach, p).error_bound
    assert dense.energy(exact - p) <= bound * dense.energy(p)
    assert bound < 1e-10


def test_certificate_with_nothing_but_holes_and_contact():
    problem = periodic.rough(8, 8, 1, holes=0.3)
    exact, _ = periodic.by_pivoting(problem, 3 * np.nanmax(problem.gap))
    assert (exact[~np.isnan(problem.gap)] > 0).mean() > 0.9
    assert certified(problem, 3 * np.nanmax(problem.gap), exact).error_bound < 1e-6
    assert certified(problem, 3 * np.nanmax(problem.gap), 1.01 * exact).error_bound > 0.003


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


def test_one_cell_at_least_stays_open_below_the_approach_of_full_contact():
    problem = periodic.rough(12, 10, 2)
    operator = InfluenceOperator(problem.grid, problem.material.compliance)
    state = contact_state(operator, UndeformedDistance(operator, problem.gap))
    state.approach = 2 * problem.gap.mean()
    assert state.approach == pytest.approx(problem.gap.mean(), rel=1e-9)
    assert state.approach < problem.gap.mean()
    state.contact[...] = True
    state.before_iteration(1)
    assert np.flatnonzero(~state.contact) == problem.gap.argmax()
    energy, cells = operator.energy_of_contact()
    assert cells == problem.grid.n - 1
    assert energy == pytest.approx(operator.diagonal, rel=1e-9)  # p = 1 is p = -1 on what is open


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


@pytest.mark.parametrize(("nx", "ny"), [(45, 31), (50, 51), (33, 64)])
def test_means_of_samples_are_those_of_the_target_on_all_grids(nx, ny):
    """Else a coarse grid would be in full contact, or beyond, before the target is."""
    grid = Grid.from_domain(nx, ny, (0, 1, 0, 1), "spectral")
    gap = random_field(grid, 1)
    with ContactSolver(
        ContactProblem(grid, Material.from_contact_modulus(1.0), gap, periodic=True)
    ) as solver:
        means = [distance.statistics.mean + distance.reference for distance in solver._distances]
    np.testing.assert_allclose(means, gap.mean(), rtol=0, atol=1e-14)


@pytest.mark.parametrize("shape", [(9, 9), (64, 65), (65, 64), (20, 3)])
def test_distances_of_an_array_move_on_every_grid(shape):
    """Coarse grids of odd numbers of cells have means of overlaps: b and the Vec are one array."""
    gap = np.random.default_rng(1).random(shape)
    grid = Grid(shape[1], shape[0], 1 / shape[1], 1 / shape[0])
    problem = ContactProblem(grid, Material.combined(1.0, 0.0), gap, periodic=True)
    hierarchy = Hierarchy(problem.grid, 1.0, MPI.COMM_SELF)
    shapes = hierarchy.shapes(problem)
    assert len(shapes) > 1
    for operator, shape_there in zip(hierarchy.levels, shapes, strict=True):
        distance = UndeformedDistance(operator, shape_there)
        distance.move_to(0.25)
        np.testing.assert_array_equal(distance.h_at(0.25), shape_there - 0.25)
        assert np.shares_memory(distance.b, distance.rhs.getArray(readonly=True))
        distance.destroy()
    hierarchy.destroy()


@pytest.mark.parametrize("method", ["norm", "fmg_v11"])
def test_few_cells_of_an_odd_grid_take_a_load(method):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        gap = 0.1 * rng.random((9, 9))
        gap[rng.random((9, 9)) < 0.9] = np.nan
        problem = ContactProblem(
            Grid.from_domain(9, 9, (0, 1, 0, 1)), Material.from_contact_modulus(1e3), gap, periodic=True
        )
        with ContactSolver(problem, method) as solver:
            found = solver.solve(load=1.0)
        assert found.converged and found.load == pytest.approx(1.0)


def test_the_bound_asked_for_is_proved_by_any_method():
    grid = Grid.from_domain(64, 64, (0, 1, 0, 1))
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = 0.01 * np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y)
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), gap, periodic=True)
    bounds = {}
    for wanted in (0.01, 7e-6):
        with ContactSolver(problem, "fmg_v11", {"lcp_error_bound": wanted}) as solver:
            found = solver.solve(approach=-0.005)
        assert found.converged
        bounds[wanted] = found.error_bound
    assert bounds[7e-6] <= 7e-6 < bounds[0.01]


@pytest.mark.parametrize("share", [1e-3, 1e-8, 1e-12])
def test_a_mean_gap_near_first_touch_keeps_its_digits(share):
    """The mean undeformed distance is summed without rounding: what it exceeds a mean gap by is the depth."""
    gap = np.random.default_rng(1).random((30, 41))
    gap[7, 8] = 0.0
    problem = ContactProblem(Grid(41, 30, 0.1, 0.1), Material.from_contact_modulus(1e5), gap, periodic=True)
    wanted = (1 - share) * gap.mean()
    depth = sum(map(Fraction, gap.ravel().tolist())) / gap.size - Fraction(wanted)
    with ContactSolver(problem) as solver:
        found = solver.solve(mean_gap=wanted)
    assert found.indentation == pytest.approx(float(depth), rel=1e-15, abs=0)


def test_a_deeper_solve_leaves_nothing_of_its_rounding():
    """A cell touches alone, at an approach far smaller than the one before."""
    grid, approach = Grid.from_domain(32, 32, (0, 1, 0, 1)), 1e-9
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = (x - 0.5) ** 2 + (y - 0.5) ** 2
    gap[16, 16], gap[15, 15], gap[15, 16], gap[16, 15] = 0, 0.01, 0.01, 0.01
    problem = ContactProblem(grid, Material.from_contact_modulus(1e3), gap, periodic=True)
    with ContactSolver(problem, options={"lcp_error_bound": 1e-8}) as solver:
        exact = approach / solver.hierarchy.target.diagonal
        for deeper in (None, 0.15):
            if deeper:
                solver.solve(approach=deeper)
            found = solver.solve(approach=approach)
            assert found.contact.sum() == 1
            assert abs(found.max_pressure / exact - 1) <= max(found.error_bound, 1e-13)
