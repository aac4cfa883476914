"""The primal form, piece by piece: sweeps against plain numpy, B, its preconditioner, the steps of the state."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import periodic
import pytest
from mpi4py import MPI
from operators import PERIODIC, STEEL, mat_times, random_field
from petsc4py import PETSc

from app import ContactProblem, ContactSolver, SelfAffineSurface, solve
from app.base.errors import InputError
from app.contact.active_set import CONVERGED
from app.contact.distance import UndeformedDistance
from app.contact.loading import PrescribedApproach
from app.contact.periodic_state import contact_state
from app.contact.prescribed_load import PrescribedLoad
from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.halfspace.operator import InfluenceOperator
from app.methods.periodic import iteration, kernels, stencil
from app.methods.periodic.operator import InverseOperator
from app.methods.periodic.solver import PrimalSolver
from app.methods.periodic.state import PrimalState
from app.methods.stopping import InexactStop
from app.multigrid.hierarchy import Hierarchy
from app.options.method import read_method_file
from app.options.solver_options import SolverOptions
from app.parallel.halo import Halo
from app.parallel.slabs import Slabs

WEIGHTS = 0.7, *(np.float32(w) for w in (-0.19, -0.16, -0.04))
SHAPES = (8, 12), (4, 64), (1, 8), (8, 1), (2, 4), (12, 2), (5, 7), (3, 33)
SINGLE = 2e-6

each_shape = pytest.mark.parametrize("shape", SHAPES, ids=[f"{ny}x{nx}" for ny, nx in SHAPES])
SHARES = np.array([1.1, 0.7, 0.9, 1.3, 0.8, 1.0, 0.6, 1.2], np.float32)
each_loading = pytest.mark.parametrize(
    "loading", [partial(PrescribedLoad, 1e2), partial(PrescribedApproach, 0.03)], ids=["load", "approach"]
)
each_count = pytest.mark.parametrize("steps", [1, 2, 3, 5, 8])


def neighbours(x, weights=WEIGHTS):
    """What the eight neighbours of every cell add to it, over the period."""
    _, wx, wy, wd = weights

    def beside(field, axis):
        return np.roll(field, 1, axis) + np.roll(field, -1, axis)

    return wx * beside(x, 1) + wy * beside(x, 0) + wd * beside(beside(x, 0), 1)


def swept(source, free, shares, x):
    """Richardson's iteration with some steps."""
    for share in shares:
        x = free * (x + share * (source - neighbours(x) - x))
    return x


def fields(shape, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape), rng.random(shape) < 0.6


def slabs_of(shape, width):
    """The parts of a field that two ranks would own, each with the rows beside it."""
    cut = shape[0] // 3 if shape[0] > 2 else 0
    for a, b in ((0, cut), (cut, shape[0])):
        before, after = (np.arange(first, first + width) % shape[0] for first in (a - width, b))
        yield slice(a, b), before, after


def no_x(nx):
    """In the place of fields to begin sweeps with."""
    return (np.empty((0, nx), np.float32),) * 3


def no_waves(nx):
    """In the place of long waves: none, nowhere, with room for their rows."""
    return np.empty((0, 0)), ((1.0, 0.0), (1.0, 0.0)), (np.empty(0, np.float32), np.empty(nx, np.float32))


FACTORS = (1, 1), (2, 2), (4, 4), (1, 2), (4, 1), (2, 4)


@each_shape
@pytest.mark.parametrize("factors", FACTORS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_sums_in_coarse_cells_add_up_over_slabs_that_begin_inside_of_them(shape, factors, dtype):
    (s, free), (fy, fx) = fields(shape, 1), factors
    s = s.astype(dtype)
    x = (free * fields(shape, 2)[0]).astype(np.float32)
    coarse = np.zeros((3, *(-(-n // f) for n, f in zip(shape, factors, strict=True))))
    for rows, before, after in slabs_of(shape, 2):
        parts = np.full((3, -(-rows.stop // fy) - rows.start // fy, coarse.shape[2]), np.nan)
        place = rows.start % fy, factors, np.empty(shape[1], np.float32)
        stencil.free_in_cells(s[rows], free[rows], 0.7, parts[0], *place)
        stencil.contact_in_cells(free[rows], parts[1], *place)
        three = np.zeros((3, shape[1] + 2), np.float32)
        around = x[rows], x[before], x[after]
        stencil.residual_in_cells(
            s[rows], free[rows], WEIGHTS, *around, parts[2], *place[:2], three, place[2]
        )
        coarse[:, rows.start // fy :][:, : parts.shape[1]] += parts
    left = free * (WEIGHTS[0] * s - x - neighbours(x))
    for field, found in zip((0.7 * s * free, ~free, left), coarse, strict=True):
        filled = np.zeros([n * f for n, f in zip(found.shape, factors, strict=True)])
        filled[: shape[0], : shape[1]] = field  # the last coarse cells may have fewer children
        expected = filled.reshape(len(found), fy, -1, fx).mean((1, 3))
        np.testing.assert_allclose(found, expected, rtol=0, atol=SINGLE)


@each_shape
@each_count
def test_sweeps_are_richardsons_from_zero(shape, steps):
    (s, free), shares, room = fields(shape, steps), SHARES[:steps], stencil.make_work(steps, shape[1])
    expected = swept(free * s * WEIGHTS[0], free, shares, np.zeros(shape))
    z = np.full(shape, np.nan)
    for rows, before, after in slabs_of(shape, steps - 1):
        beside = s[before], s[after], free[rows], free[before], free[after]
        more = *no_x(shape[1]), *no_waves(shape[1]), z[rows], room
        stencil.sweep(s[rows], *beside, WEIGHTS, shares, *more)
    np.testing.assert_allclose(z, expected, rtol=0, atol=SINGLE * abs(expected).max())
    assert (z[~free] == 0).all()


@each_shape
@each_count
def test_sweeps_are_richardsons_from_something(shape, steps):
    s, free = fields(shape, steps)
    source, start = free * s * WEIGHTS[0], (free * fields(shape, 99)[0]).astype(np.float32)
    shares, room = np.append(np.float32(0), SHARES[:steps]), stencil.make_work(1 + steps, shape[1])
    expected = swept(source, free, SHARES[:steps], start)
    z, x = np.full(shape, np.nan), start.copy()
    for rows, before, after in slabs_of(shape, steps):
        inside = s[rows], s[before], s[after], free[rows], free[before], free[after], WEIGHTS, shares
        inside += x[rows], start[before], start[after], *no_waves(shape[1])
        stencil.sweep(*inside, z[rows], room)
        stencil.sweep(*inside, x[rows], room)  # x may be z
    for found in (z, x):
        np.testing.assert_allclose(found, expected, rtol=0, atol=SINGLE * abs(expected).max())
        assert (found[~free] == 0).all()


@each_shape
@each_count
@pytest.mark.parametrize("more", [0, 3])
def test_projected_sweeps_stay_above_the_bound(shape, steps, more):
    f, low = (fields(shape, seed)[0].astype(np.float32) for seed in (steps, 50))
    low[fields(shape, 51)[1]] = -np.inf
    expected = np.maximum(f, low)
    for _ in range(steps - 1):
        expected = np.maximum(f - neighbours(expected), low)
    x, room = np.full(shape, np.nan, np.float32), stencil.make_work(steps, shape[1], np.float32)
    for rows, before, after in slabs_of(shape, steps - 1 + more):
        beside = f[before], f[after], low[rows], low[before], low[after]
        stencil.sweep_projected(f[rows], *beside, WEIGHTS, steps, x[rows], room)
    np.testing.assert_allclose(x, expected, rtol=0, atol=SINGLE * abs(expected).max())
    assert (x >= low).all()


def coarsened(grid, factors):
    """A grid of cells so many times as large, powers of two."""
    while max(factors) > 1:
        halved = grid.coarsen(1)
        halved = replace(
            grid,
            **{name: getattr(halved, name) for name in ("ny", "dy", "y0") if factors[0] > 1},
            **{name: getattr(halved, name) for name in ("nx", "dx", "x0") if factors[1] > 1},
        )
        grid, factors = halved, tuple(max(factor // 2, 1) for factor in factors)
    return grid


def bilinear(places, n, count):
    """Matrix of the interpolation from `count` cells to n, over the period."""
    centre = places[0] * np.arange(n) + places[1]
    below, matrix = np.floor(centre).astype(int), np.zeros((n, count))
    np.add.at(matrix, (np.arange(n), below % count), below + 1 - centre)
    np.add.at(matrix, (np.arange(n), (below + 1) % count), centre - below)
    return matrix


@pytest.mark.parametrize("steps", [1, 3, 8])
@pytest.mark.parametrize("factors", FACTORS)
@pytest.mark.parametrize("shape", [(8, 12), (4, 4), (4, 24), (7, 10), (6, 13)])
def test_long_waves_are_interpolated_bilinearly_and_added_to_the_first_sweep(shape, factors, steps):
    (s, free), shares, beside = fields(shape, 1), SHARES[:steps], steps - 1
    grid = Grid(shape[1], shape[0], 0.5, 2.0, periodic="spectral")
    below = coarsened(grid, factors)
    (ay, by), in_x = grid.places_in(below)
    coarse = fields(below.shape, 2)[0]
    z, room = np.full(shape, np.nan, np.float32), stencil.make_work(steps, shape[1])
    for rows, before, after in slabs_of(shape, beside):
        low = int(np.floor(ay * (rows.start - beside) + by))
        high = int(np.floor(ay * (rows.stop - 1 + beside) + by)) + 3  # one more, should rounding ask for it
        around = coarse[np.arange(low, high) % len(coarse)]
        places = (ay, ay * (rows.start - beside) + by - low), in_x
        of_waves = np.empty(below.nx + 2, np.float32), np.empty(shape[1], np.float32)
        outside = s[before], s[after], free[rows], free[before], free[after]
        stencil.sweep(
            s[rows], *outside, WEIGHTS, shares, *no_x(shape[1]), around, places, of_waves, z[rows], room
        )
    source = free * s * WEIGHTS[0]
    waves = bilinear((ay, by), shape[0], below.ny) @ coarse @ bilinear(in_x, shape[1], below.nx).T
    expected = swept(source, free, shares[1:], shares[0] * source + free * waves)
    np.testing.assert_allclose(z, expected, rtol=0, atol=SINGLE * abs(expected).max())


@pytest.mark.parametrize("width", [1, 3, 7, 20])
@pytest.mark.parametrize("rows", [1, 2, 6])
def test_rows_beside_a_slab_come_round_the_period(rows, width):
    field = np.arange(3.0 * rows).reshape(rows, 3)
    before, after = Halo(Slabs(rows), None, width)(field)
    np.testing.assert_array_equal(before, field[np.arange(-width, 0) % rows])
    np.testing.assert_array_equal(after, field[np.arange(width) % rows])


# -- the operator and its preconditioner ---------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "off"), [(np.float64, 1e-12), (np.float32, 2e-5)])
@pytest.mark.parametrize("grid", PERIODIC.values(), ids=PERIODIC.keys())
def test_b_is_the_inverse_but_for_the_mean_and_positive_on_the_free_cells(grid, dtype, off):
    influence = InfluenceOperator(grid, STEEL, dtype=dtype)
    inverse, p = InverseOperator(influence), random_field(grid, 1)
    u, back = np.empty(grid.shape), np.empty(grid.shape)
    influence.exact_displacement(p, u)
    for compute in (inverse.pressure, inverse.exact_pressure):
        compute(u, back)
        np.testing.assert_allclose(back, p - p.mean(), rtol=0, atol=off * abs(p).max())
    inverse.mask[...] = np.random.default_rng(2).random(grid.shape) < 0.7
    mat = inverse.mat(PETSc.COMM_SELF)
    x, y = (random_field(grid, seed) * inverse.mask for seed in (3, 4))
    bx, by = (mat_times(mat, field).reshape(grid.shape) for field in (x, y))
    assert (bx[~inverse.mask] == 0).all()
    assert np.vdot(bx, x) > 0
    assert np.vdot(bx, y) == pytest.approx(np.vdot(x, by), abs=off * np.vdot(bx, x))
    assert inverse.products == 2
    mat.destroy()


@pytest.fixture
def make():
    """Make solvers of grids of a size, symbol, share of contact; free them in the end."""
    made = []

    def solver(grid, share=0.3, seed=1, dtype=np.float32, **options):
        hierarchy = Hierarchy(grid, STEEL, MPI.COMM_SELF, dtype=dtype)
        texts = read_method_file("primal") | {name: str(text) for name, text in options.items()}
        with SolverOptions("", texts).inserted():
            made.append(PrimalSolver(hierarchy))
        made[-1].inverse.mask[...] = np.random.default_rng(seed).random(grid.shape) >= share
        made[-1].set_contact()
        return made[-1]

    yield solver
    for one in made:
        one.destroy()


def patch(nx, ny, stretch=1.0, symbol="spectral"):
    return Grid(nx, ny, 1.0 / nx, stretch / nx, periodic=symbol)


GRIDS = {
    "square": patch(32, 32),
    "stretched": patch(32, 24, 3.0, "love"),
    "odd": patch(21, 15),
    "one row": patch(64, 1),
    "two columns": patch(2, 64),
    "long cells": patch(24, 20, 20.0),
    "flat cells": patch(24, 20, 0.05),
    "two rows of flat cells": patch(64, 2, 0.05),
}
each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())


def applied(solver, field):
    z = np.empty(field.shape)
    solver.preconditioner.smooth(field, z)
    return z


@each_grid
@pytest.mark.parametrize("share", [0.0, 0.03, 0.3, 0.5, 0.97])
def test_preconditioner_is_positive_and_brings_all_eigenvalues_near_one(make, grid, share):
    solver = make(grid, share)
    free, inverse = solver.inverse.mask, solver.inverse
    assert (applied(solver, random_field(grid, 5))[~free] == 0).all()
    units = np.eye(grid.n).reshape(-1, *grid.shape)[free.reshape(-1)]
    m, b = np.empty((2, len(units), len(units)))
    pressure = np.empty(grid.shape)
    for unit, of_m, of_b in zip(units, m, b, strict=True):
        of_m[...] = applied(solver, unit)[free]
        inverse.exact_pressure(unit, pressure)
        of_b[...] = pressure[free]
    assert np.linalg.eigvalsh(m + m.T).min() > 0
    found = np.linalg.eigvals(b @ m)
    found = found[abs(found) > 1e-9]  # B does not see the constant
    assert len(found) >= len(units) - (share == 0)
    long = max(grid.dx / grid.dy, grid.dy / grid.dx) > 4  # of which the coarser grid does not hold all waves
    assert (
        found.real.min() > (0.08 if long else 0.35) and found.real.max() < 2 and abs(found.imag).max() < 0.25
    )
    free.flat[np.flatnonzero(free)[::2]] = False  # another contact set, of which it is told
    solver.set_contact()
    assert (applied(solver, random_field(grid, 6))[~free] == 0).all()


@each_grid
def test_constrained_it_keeps_the_mean_and_shift_moves_it(make, grid):
    solver = make(grid)
    pc, free, r = solver.preconditioner, solver.inverse.mask, random_field(grid, 6)
    loose = applied(solver, r * free)
    pc.constrained = True
    kept = applied(solver, r * free)
    assert abs(kept.mean()) <= 1e-12 * abs(kept).max()
    assert (kept[~free] == 0).all()
    one = applied(
        solver, np.ones(grid.shape)
    )  # of a constant pressure nothing is left: all of it is the multiplier
    assert abs(one).max() <= 1e-5 * abs(loose).max()
    assert pc.multiplier == pytest.approx(1.0, rel=1e-6)
    w = r.copy()
    pc.shift(0.7, w)
    assert w.sum() - r.sum() == pytest.approx(0.7, rel=1e-12)
    assert (w[~free] == r[~free]).all() and (w[free] >= r[free]).all()
    free[...] = False
    solver.set_contact()
    before = w.copy()
    pc.shift(0.7, w)  # nothing is there to be raised
    np.testing.assert_array_equal(w, before)
    np.testing.assert_array_equal(applied(solver, r), 0)


@pytest.mark.parametrize("share", [0.003, 0.03])
@pytest.mark.parametrize("n", [64, 128, 256])
def test_a_constant_is_as_compliant_as_scattered_contact_lets_it(make, n, share):
    """Whatever part of the patch a cell is."""
    solver = make(patch(n, n), share)
    ones = np.ones((n, n))
    raised = applied(solver, ones).astype(np.float32)
    pressure = np.empty_like(raised)
    solver.inverse.pressure(raised, pressure)
    assert 0.6 < np.vdot(raised, pressure) / raised.sum() < 1.4


def test_it_does_not_know_where_the_patch_begins(make):
    grid, shift = patch(32, 24), (4, 8)  # whole cells of the grid of long waves
    solver, r = make(grid), random_field(grid, 7)
    free = solver.inverse.mask
    here = applied(solver, r)
    free[...] = np.roll(free, shift, (0, 1))
    solver.set_contact()
    there = applied(solver, np.roll(r, shift, (0, 1)))
    np.testing.assert_allclose(there, np.roll(here, shift, (0, 1)), rtol=0, atol=SINGLE * abs(here).max())


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"ksp_type": "cg"}, "-ksp_type: .*CarryingCG"),
        ({"pc_type": "none"}, "-pc_type: .*TwoGrid"),
        ({"pc_python_type": "app.methods.free.circulant.Circulant"}, "TwoGrid"),
        ({"ksp_norm_type": "unpreconditioned"}, "-ksp_norm_type: .*preconditioned"),
        ({"pc_two_grid_sweeps": 0}, "-pc_two_grid_sweeps 0: allowed: 1 to 50"),
        ({"pc_two_grid_sweeps": 51}, "-pc_two_grid_sweeps 51: allowed: 1 to 50"),
    ],
)
def test_what_it_cannot_use_is_refused_in_a_line(options, match):
    with pytest.raises(InputError, match=match) as refusal:
        ContactSolver(periodic.rough(16, 12, 1), "primal", options)
    assert "\n" not in str(refusal.value)


# -- the steps ------------------------------------------------------------------------------------------------


@pytest.fixture
def steps(make):
    """A PrimalState under a loading, and its solver."""
    made = []

    def primal(loading, holes=0.0, nx=24, ny=16, dtype=np.float64):
        problem = periodic.rough(nx, ny, 3, holes)
        grid = Grid(nx, ny, problem.grid.dx, problem.grid.dy, periodic="spectral")
        solver = make(grid, dtype=dtype)
        operator = solver.inverse.influence
        distance = UndeformedDistance(operator, problem.gap)
        state = contact_state(operator, distance)
        made.append(PrimalState(state, solver.inverse, loading))
        made[-1].w[...] = 0
        solver.begin(state, loading)
        return made[-1], solver

    yield primal
    for one in made:
        one.state.destroy()


def guessed(steps, loading):
    """A PrimalState whose contact set is guessed, and its solver."""
    primal, solver = steps(loading)
    primal.start(solver)
    primal.guess(solver)
    return primal, solver


def pressure_of(primal, w=None):
    p = np.empty(primal.w.shape)
    primal.inverse.exact_pressure(primal.w if w is None else w, p)
    return p + primal.mean_pressure


@each_loading
def test_without_a_product_the_solver_goes_on_where_it_was(steps, loading):
    """w and p lag until they are taken; what is to be added to them adds up, from one contact set to the next."""
    primal, solver = guessed(steps, loading())
    state = primal.state
    w, p, norms = primal.w.copy(), state.p.copy(), []
    for _ in range(3):
        norms.append(solver.improve(primal, 0.0)[2])
        primal.exchange(solver, 0.0, -np.inf, np.inf, norms[-1])  # releases only
        assert primal.pending and (primal.w == w).all()
        np.testing.assert_allclose(state.p - p, (state.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
        there = pressure_of(primal, w + solver.change)
        np.testing.assert_allclose(solver.carried, there, rtol=0, atol=1e-11 * abs(there).max())
    with primal.shown(solver):
        np.testing.assert_array_equal(state.p, solver.carried)
    np.testing.assert_allclose(state.p - p, (state.p - p).mean(), rtol=0, atol=1e-12 * abs(p).max())
    primal.commit(solver)
    assert not primal.pending and not primal.approximate
    np.testing.assert_allclose(primal.w, w + solver.change, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(state.p, solver.carried)
    taken = primal.w.copy()
    primal.commit(solver)  # there is nothing more
    assert (primal.w == taken).all()


@each_loading
@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_every_step_keeps_p_and_the_loading(steps, loading, holes):
    """p = B w + mean pressure; of an approach, the mean of w; of a load, that of p; w = b on C."""
    primal, solver = steps(loading(), holes)
    state, given = primal.state, not primal.loading.approach_is_known
    primal.w[...] = random_field(state.grid, 8) * 0.01

    def check(closed=True):
        np.testing.assert_allclose(state.p, pressure_of(primal), rtol=0, atol=1e-11 * abs(state.p).max())
        if given:
            assert state.load == pytest.approx(primal.loading.load, rel=1e-9)
        else:
            assert primal.depth == pytest.approx(primal.prescribed_depth, rel=1e-9)
        assert not state.contact[~state.admissible].any()
        assert (primal.inverse.mask == ~state.contact).all()
        if closed:
            assert (primal.w == state.distance.b)[state.contact].all()

    primal.start(solver)
    primal.guess(solver)
    check()
    for _ in range(4):
        before = state.p[~state.contact]
        solver.improve(primal, 0.0)
        p, w = solver.carried.copy(), primal.w + solver.change
        np.testing.assert_allclose(p, pressure_of(primal, w), rtol=0, atol=1e-11 * abs(p).max())
        assert np.linalg.norm(p[~state.contact]) < 0.9 * np.linalg.norm(before)
        old = state.contact.copy()
        wrong = state.contact & (p < 0), ~state.contact & state.admissible & (w < state.distance.b)
        update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
        assert (state.contact == (old & ~wrong[0]) | wrong[1]).all()
        assert (update.cells, update.added, update.released) == (
            state.contact.sum(),
            wrong[1].sum(),
            wrong[0].sum(),
        )
        moves = (w - state.distance.b)[wrong[1]], p[wrong[0]] / solver.preconditioner.stiffness
        assert update.moves == pytest.approx(np.linalg.norm(np.concatenate(moves)), rel=1e-6)
        check(closed=False)
        primal.close_captured_gaps(solver)
        check()


@pytest.mark.parametrize("loading", ["load", "approach"])
def test_cells_that_change_by_too_little_to_matter_need_no_more_sets(monkeypatch, loading):
    ends, verified, verify, steel = [], [], iteration.verify, Material.combined(80000.0, 0.3)
    monkeypatch.setattr(iteration, "verify", lambda *given: verified.append(None) or verify(*given))
    patch = Grid.from_domain(96, 96, (0, 1, 0, 1))

    def problem_of(seed):
        height = SelfAffineSurface(0.8, 1 / 4, 1 / 24, (1.0, 1.0), seed, rms_slope=0.1)
        return ContactProblem(patch, steel, surfaces=[height], periodic=True)

    for seed in range(1, 13):
        problem = problem_of(seed)
        deviation = problem.shape_on(patch).std()
        with ContactSolver(problem, options={"lcp_rtol": 1e-10}) as solver:
            right = solver.solve(load=0.03 * steel.contact_modulus)
        verified.clear()
        found = solve(problem, options={"lcp_rtol": 1e-4}, **{loading: getattr(right, loading)})
        assert len(verified) == 1  # it passes at once
        gap = found.gap[found.contact]
        off = gap - gap.mean() if loading == "load" else gap
        assert np.sqrt(np.mean(off**2)) < 1e-4 * deviation
        assert np.linalg.norm(found.pressure - right.pressure) < 2e-3 * np.linalg.norm(right.pressure)
        ends.append(found.attributes["reason"])
    assert len(set(ends)) == 2

    exchange = PrimalState.exchange
    monkeypatch.setattr(
        PrimalState, "exchange", lambda *given: exchange(*given)._replace(moves=np.inf)
    )  # they do matter
    for seed in range(1, 13):
        found = solve(problem_of(seed), load=0.03 * steel.contact_modulus, options={"lcp_rtol": 1e-4})
        assert found.attributes["reason"] == CONVERGED


@pytest.mark.parametrize(("cut_off", "seed"), [(4, 3), (4, 2), (8, 6)])
def test_nor_is_a_single_cell_left_to_overlap_by_much(cut_off, seed):
    steel, patch = Material.combined(80000.0, 0.3), Grid.from_domain(256, 256, (0, 1, 0, 1))
    surface = SelfAffineSurface(0.8, 1 / 8, cut_off / 256, (1.0, 1.0), seed, rms_slope=0.1)
    problem = ContactProblem(patch, steel, surfaces=[surface], periodic=True)
    found = solve(problem, mean_pressure=0.14 * steel.contact_modulus)
    assert found.converged
    assert -found.gap.min() < 1e-5 * problem.shape_on(patch).std()


@each_loading
def test_if_they_matter_after_all_it_goes_on(steps, loading):
    primal, solver = guessed(steps, loading())
    state = primal.state
    norm = solver.improve(primal, 0.0)[2]
    update = primal.exchange(solver, 0.0, 0.0, np.inf, norm)
    free = ~state.contact
    primal.commit(solver)
    accuracy = iteration._Accuracy(1e-9)
    stop = InexactStop(1e-6, 100, True)
    verdict = iteration._judge(primal, solver.scratch, stop, accuracy.allowed)
    iteration._continue(verdict, primal, solver, accuracy, norm / np.sqrt(primal.cells), True)
    assert update.added and not verdict.solved and accuracy.verification_failed
    np.testing.assert_array_equal(free, ~state.contact)
    np.testing.assert_array_equal(primal.w[state.contact], state.distance.b[state.contact])
    np.testing.assert_allclose(state.p, pressure_of(primal), rtol=0, atol=1e-11 * abs(state.p).max())


def test_under_a_load_something_stays_in_contact(steps):
    primal, solver = guessed(steps, PrescribedLoad(1e2))
    before = primal.state.contact.copy()
    solver.carried[...] = -1.0
    solver.change[...] = 1.0
    update = primal.exchange(solver, 0.0, 0.0, np.inf, 0.0)
    assert (update.cells, update.changed) == (before.sum(), 0)
    assert (primal.state.contact == before).all() and (primal.inverse.mask == ~before).all()


@pytest.mark.parametrize("cut", [0, 2, 5])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_centre_of_b_is_added_as_it_is_defined(cut, dtype):
    """Columns wrap around; rows beside the slab, of which the nearest count, are given."""
    rng = np.random.default_rng(2)
    d, weights = rng.normal(size=(5, 6)).astype(dtype), (0.5, 0.3, -0.2, 0.1)
    around = np.pad(d, 1, mode="wrap").astype(float)
    expected = 2 * sum(
        (1.0, 0.3, -0.2, 0.1)[abs(x) + 2 * abs(y)] * around[1 + y : 6 + y, 1 + x : 7 + x]
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
    )
    found = np.ones((5, 6))
    for rows in (slice(0, cut), slice(cut, 5)):
        before, after = np.roll(d, -rows.start, 0)[-2:], np.roll(d, -rows.stop, 0)[:2]
        if rows.start < rows.stop:
            stencil.add_centre(d[rows], before, after, weights, np.empty((3, 8)), found[rows])
    np.testing.assert_allclose(found, 1 + expected, rtol=0, atol=1e-6)


def test_what_overlaps_touches():
    rng = np.random.default_rng(3)
    w, b, contact, admissible = *rng.normal(size=(2, 6, 7)), *(rng.random((2, 6, 7)) < 0.5)
    contact &= admissible
    touches, before, change = contact | (admissible & (w <= b)), w.copy(), np.empty((6, 7))
    kernels.touch(w, b, admissible, contact, change)
    np.testing.assert_array_equal(contact, touches)
    np.testing.assert_array_equal(w, np.where(touches, b, before))
    np.testing.assert_array_equal(change, np.where(touches, b - before, 0))


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_a_start_from_a_pressure_knows_it_well_enough(steps, holes):
    """Closing overlaps is for short waves: the centre of B makes most of what B makes of it."""
    primal, solver = steps(PrescribedLoad(1e2), holes)
    primal.w[...] = primal.state.distance.b.mean() + 1e-3 * primal.state.distance.b
    primal.refresh()
    before = primal.state.p.copy()
    primal._has_pressure = True
    primal.start(solver)
    found = primal.state.p.copy()
    primal.refresh(exact=True)
    moved, missing = primal.state.p - before, primal.state.p - found
    assert primal.state.cells_in_contact() and np.linalg.norm(moved) > 0
    assert np.linalg.norm(missing) < 0.3 * np.linalg.norm(moved)


def test_flops_of_the_steps_of_cg_are_logged(steps):
    primal, solver = guessed(steps, PrescribedLoad(1e2))
    inverse = primal.inverse
    products, before = inverse.product.count, PETSc.Log.getFlops()
    iterations, *_ = solver.improve(primal, 0.0)
    flops = PETSc.Log.getFlops() - before - (inverse.product.count - products) * inverse.product.flops
    assert flops >= 10 * iterations * inverse.grid.n > 0


@pytest.mark.parametrize("count", [1, 2, 5])
def test_it_is_flexible_cg_step_for_step(steps, count):
    primal, solver = guessed(steps, PrescribedLoad(1e2))
    left = np.where(primal.inverse.mask, -primal.state.p, 0.0)
    other = PETSc.KSP().create(PETSc.COMM_SELF)
    other.setOperators(solver.mat)
    other.setType("fcg")
    PETSc.Options().setValue("other_ksp_fcg_mmax", "1")
    other.setOptionsPrefix("other_")
    other.setFromOptions()
    other.getPC().setType("python")
    other.getPC().setPythonContext(solver.preconditioner)
    other.setTolerances(rtol=0, atol=0, max_it=count)
    b, x = solver.mat.createVecs()
    b.setArray(left.reshape(-1))
    other.solve(b, x)
    solver.ksp.setTolerances(rtol=1e-300, max_it=count)
    iterations, _, norm = solver.improve(primal, 0.0)
    assert iterations == count
    moved = solver.change
    np.testing.assert_allclose(moved.reshape(-1), x.getArray(), rtol=0, atol=1e-6 * abs(moved).max())
    expected = np.empty_like(moved)
    primal.inverse.exact_pressure(primal.w + moved, expected)
    expected += primal.mean_pressure
    np.testing.assert_allclose(solver.carried, expected, rtol=0, atol=1e-10 * abs(expected).max())
    assert norm == pytest.approx(np.linalg.norm(solver.scratch), rel=1e-12)
    PETSc.Options().delValue("other_ksp_fcg_mmax")
    for thing in (other, b, x):
        thing.destroy()


@pytest.mark.parametrize("given", [{"approach": 1e-3}, {"mean_pressure": 10.0}])
def test_surfaces_with_holes_that_are_hardly_uneven_are_as_flat_ones(given):
    """Down to what rounding leaves of a plane, their heights ask for no more than the depth can be known to."""
    numbers, material = np.random.default_rng(2), Material.from_contact_modulus(1e4)
    for n in (3, 8, 16, 24, 64):
        for height in 10.0 ** np.arange(-16, -3):
            gap = numbers.random((n, n)) * height
            gap[numbers.random((n, n)) < 0.1] = np.nan
            gap[0, 0] = np.nan
            found = solve(
                ContactProblem(Grid.from_domain(n, n, (0, 1, 0, 1)), material, gap, periodic=True), **given
            )
            assert found.converged and found.fallbacks == 0 and found.operator_applications < 30
            assert found.error_bound < 1e-4


def test_what_is_not_solved_is_a_pressure_under_the_load_all_the_same():
    numbers, material = np.random.default_rng(4), Material.from_contact_modulus(1.0)
    for _ in range(60):
        gap = numbers.random((numbers.integers(1, 8), numbers.integers(2, 12)))
        gap[numbers.random(gap.shape) < 0.3] = np.nan
        if np.isnan(gap).all():
            continue
        problem = ContactProblem(Grid(*gap.shape[::-1], 1, 1), material, gap, periodic=True)
        with warnings.catch_warnings(action="ignore"):
            found = solve(problem, load=1e-4, options={"lcp_max_it": 1, "ksp_max_it": 1})
        assert found.pressure.min() == 0 or not np.isnan(gap).any()
        assert (found.pressure[np.isnan(gap)] == 0).all() and (found.pressure >= 0).all()
        assert found.pressure.sum() == pytest.approx(1e-4)
