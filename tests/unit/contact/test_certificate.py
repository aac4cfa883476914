"""The certificate bounds the error of any pressure."""

from dataclasses import replace

import numpy as np
import periodic
import pytest
from cases import periodic_rough
from scipy.optimize import lsq_linear

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.certificate import _best, _largest_error, certify, estimate
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.influence import dense_matrix
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.verification.dense import DenseProblem


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("p", "smallest"), [((3.0, -0.25, 0.5, 0.0), -0.25), ((3.0, 0.5, 0.0, 0.5), -0.5)])
def test_forbidden_pressure_has_no_error_bound(periodic, p, smallest):
    """Pressures that are negative, or in inadmissible cells; rounding errors are allowed."""
    operator = InfluenceOperator(Grid(4, 1, 1.0, 1.0, periodic=periodic), UNIT)
    for share, bounded in (1.0, False), (1e-16, True):
        state = contact_state(operator, UndeformedDistance(operator, np.array([[0.0, 1.0, 2.0, np.nan]])))
        with state.pressure as values:
            values[:] = [p[0], *(share * value for value in p[1:])]
        state.displacement_status = Displacement.STALE
        found = certify(state)
        assert np.isfinite(found.error_bound) == bounded
        assert found.smallest_pressure == pytest.approx(share * smallest)


@pytest.mark.parametrize("periodic", [False, True])
def test_nan_pressure_has_no_error_bound(periodic):
    operator = InfluenceOperator(Grid(4, 2, 1.0, 1.0, periodic=periodic), UNIT)
    state = contact_state(operator, UndeformedDistance(operator, np.arange(8.0).reshape(2, 4)))
    with state.pressure as p:
        p[:2] = 1.0, np.nan
    found = certify(state)
    assert found.error_bound == np.inf
    assert np.isnan([found.duality_gap, found.largest_penetration, found.smallest_pressure]).all()


@pytest.mark.parametrize("method", ["fmg_v11", "norm", None])
def test_products_of_the_certificate_are_counted(method):
    with ContactSolver(periodic_rough(32), method) as solver:
        before = solver.hierarchy.operator_applications()
        found = solver.solve(load=30.0)
        assert found.operator_applications == solver.hierarchy.operator_applications() - before


def certified(problem, approach, p):
    return certify(pressed(problem, approach, p))


def pressed(problem, approach, p):
    operator = InfluenceOperator(problem.grid, problem.material.kernel)
    upper = None if problem.hardness is None else np.broadcast_to(problem.hardness, problem.gap.shape)
    state = contact_state(operator, UndeformedDistance(operator, problem.gap, hardness=upper))
    state.approach = approach
    state.pressure.setArray(p.ravel())
    state.compute_displacement()
    return state


@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("seed", range(6))
def test_error_bound_holds_on_periodic_patches_with_a_hardness(seed, holes):
    """Pressures differ in all cells or not at bounds, and have the load of the solution or not."""
    rng, problem = np.random.default_rng(seed), periodic.rough(9, 8, seed, holes)
    soft = 0.02 * np.exp(rng.normal(size=problem.gap.shape)) if seed % 2 else np.full(problem.gap.shape, 0.03)
    soft[rng.random(soft.shape) < 0.3 * (seed > 3)] = np.inf
    problem = replace(problem, hardness=soft)
    dense, approach = DenseProblem(problem), (0.5, 0.9, 1.3)[seed % 3] * np.nanmean(problem.gap)
    exact, inside = dense.at(approach).astype(float), ~np.isnan(problem.gap)
    for size in (1e-9, 1e-6, 1e-3, 0.1, 10.0):
        noise = size * exact.max() * rng.normal(size=exact.shape)
        for moved in (inside, (exact > 0) & (exact < soft)):
            p = np.clip(exact + noise * moved, 0, soft)
            found, missing = [certified(problem, approach, p)], exact.sum() - p.sum()
            same = p + missing * moved / max(np.count_nonzero(moved), 1)
            pressures = [p]
            if ((same >= 0) & (same <= soft)).all():
                pressures.append(same)
                found.append(certified(problem, approach, same))
            for pressure, certificate in zip(pressures, found, strict=True):
                error, norm = dense.energy(pressure - exact), dense.energy(pressure)
                assert error * (1 - 1e-6) <= certificate.error_bound * norm + 1e-9 * norm
                if size <= 1e-6 and moved is not inside:
                    assert certificate.error_bound * norm <= 20 * error + 1e-6 * norm


@pytest.mark.parametrize("seed", range(3))
def test_small_error_bound_needs_no_product(seed, monkeypatch):
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
def test_error_bound_is_sharp_at_first_touch(depth, share):
    """Large sums of gaps outside contact do not enter the bound."""
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
def test_error_bound_includes_the_rounding_of_a_stored_matrix(shape, symbol, share):
    """Coefficients of long cells are much larger than the smallest eigenvalues."""
    ny, nx = shape
    gap = np.tile(np.cos(2 * np.pi * np.arange(nx) / nx + 1), (ny, 1))
    problem = ContactProblem(Grid(nx, ny, 1.0, 1e4), periodic.MATERIAL, gap, periodic=symbol)
    dense, approach = DenseProblem(problem), (1 - share) * gap.min() + share * gap.mean()
    exact = dense.at(approach)
    p, contact = np.zeros(problem.grid.n), (exact > 0).ravel()
    rounded = dense_matrix(problem.grid, problem.material.kernel)[np.ix_(contact, contact)]
    p[contact] = np.linalg.solve(rounded, approach - gap.ravel()[contact])
    p = p.reshape(shape)
    bound = certified(problem, approach, p).error_bound
    assert dense.energy(exact - p) <= bound * dense.energy(p)
    assert bound < 1e-10


def test_error_bound_without_open_cells():
    problem = periodic.rough(8, 8, 1, holes=0.3)
    exact, _ = periodic.by_pivoting(problem, 3 * np.nanmax(problem.gap))
    assert (exact[~np.isnan(problem.gap)] > 0).mean() > 0.9
    assert certified(problem, 3 * np.nanmax(problem.gap), exact).error_bound < 1e-6
    assert certified(problem, 3 * np.nanmax(problem.gap), 1.01 * exact).error_bound > 0.003


def test_requested_error_bound_is_proved():
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


def test_certificate_is_kept_until_the_state_changes():
    problem = periodic.rough(9, 8, 1)
    approach = 0.9 * problem.gap.mean()
    state = pressed(problem, approach, periodic.by_pivoting(problem, approach)[0])
    changes = (
        lambda: state.scale(1.01),
        lambda: setattr(state, "depth", 0.9 * state.depth),
        lambda: state.pressure.shift(1.0),
        lambda: setattr(state, "displacement_status", Displacement.STALE),
    )
    for change in changes:
        certificate = estimate(state)
        assert estimate(state) is certificate
        change()
        assert estimate(state) is not certificate


@pytest.mark.parametrize("capped", [False, True], ids=["free", "capped"])
def test_largest_error_holds_for_any_feasible_pair(capped):
    """The pair's duality gap G and distance D bound the error, more sharply than G alone."""
    rng, shares = np.random.default_rng(7), []
    for _ in range(300):
        n = int(rng.integers(1, 7))
        root = rng.normal(size=(n, n))
        a, h = root @ root.T + 10.0 ** rng.uniform(-4, 0) * np.eye(n), rng.normal(size=n)
        upper = rng.uniform(0.1, 2, n) if capped else np.full(n, np.inf)
        solution = bounded_least_squares(a, h, upper)
        p = np.clip(solution + 10.0 ** rng.uniform(-4, 0) * rng.normal(size=n), 0, upper)
        q = solution + 10.0 ** rng.uniform(-4, 0) * rng.normal(size=n)
        e = h + a @ q
        if capped:
            dual = upper @ np.maximum(-e, 0)
        else:  # to a feasible q
            q, dual = np.linalg.solve(a, np.maximum(e, 0) - h), 0.0
        gap = p @ a @ p / 2 + h @ p + q @ a @ q / 2 + dual
        squares = (p - q) @ a @ (p - q)
        error = np.sqrt((p - solution) @ a @ (p - solution))
        bound = _largest_error(gap, squares)
        assert error <= bound * (1 + 1e-6) + 1e-7 and bound <= np.sqrt(2 * max(gap, 0)) * (1 + 1e-12)
        shares.append(error / max(bound, 1e-300))
    assert max(shares) > 0.6


def test_rounding_of_a_distance_leaves_the_bound_valid():
    assert _largest_error(2.0, -1e-20) == _largest_error(2.0, 0.0) == np.sqrt(2.0)
    np.testing.assert_array_equal(_best([8.0, 2.0], [1.0, -1e-20]), (2.0, -1e-20))


def bounded_least_squares(a, h, upper):
    """Solve min p.Ap / 2 + h.p, 0 <= p <= upper."""
    root = np.linalg.cholesky(a)
    return lsq_linear(root.T, -np.linalg.solve(root, h), (0, upper), method="bvls", tol=1e-15).x
