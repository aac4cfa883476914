"""Bodies that tilt: analytic solutions, invariances, and small random problems against a dense solution.

``CONTACT_EXAMPLES=2000 python -m pytest tests/validation/test_tilt.py`` tries so many random problems.
"""

import os
import warnings

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, Paraboloid, SelfAffineSurface
from app.halfspace.influence import dense_matrix

STEEL = Material.isotropic(210e3, 0.3)
EXAMPLES = int(os.environ.get("CONTACT_EXAMPLES", 30))
TIGHT = {"lcp_rtol": 1e-10}


def solve(problem, options=None, **loading):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with ContactSolver(problem, options=options) as solver:
            return solver.solve(**loading)


def test_a_punch_under_an_eccentric_load_tilts():
    """A rigid circular punch of radius a touches everywhere while the centre is within a / 3."""
    a, load, off = 1.0, 1000.0, (0.2, -0.1)
    grid = Grid.from_domain(256, 256, (-1.1, 1.1, -1.1, 1.1))
    x, y = grid.x(), grid.y()[:, None]
    punch = ContactProblem(grid, STEEL, np.where(x**2 + y**2 < a**2, 0.0, np.nan))
    modulus = STEEL.contact_modulus
    solution = solve(punch, load=load, load_centre=off)
    assert solution.converged and solution.contact_fraction == 1
    slopes = [0.75 * load * part / (modulus * a**3) for part in off]
    assert [solution.tilt_x, solution.tilt_y] == pytest.approx(slopes, rel=0.02)
    assert solution.approach == pytest.approx(load / (2 * modulus * a), rel=0.01)
    inside = x**2 + y**2 < (0.8 * a) ** 2
    exact = load / (2 * np.pi * a * np.sqrt(np.abs(a**2 - x**2 - y**2)))
    exact = exact * (1 + 3 * (off[0] * x + off[1] * y) / a**2)
    np.testing.assert_allclose(solution.pressure[inside], exact[inside], rtol=0.03)
    beyond = solve(punch, load=load, load_centre=(0.5, 0.0))
    assert beyond.converged and 0.3 < beyond.contact_fraction < 0.95


def test_a_sphere_under_an_off_centre_load_is_the_sphere_moved():
    n, radius, load = 64, 20.0, 600.0
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    sphere = ContactProblem(grid, STEEL, Paraboloid(radius, radius))
    plain = solve(sphere, TIGHT, load=load)
    columns, rows = 7, -4
    centre = columns * grid.dx, rows * grid.dy
    moved = solve(sphere, TIGHT, load=load, load_centre=centre)
    assert moved.converged
    expected = np.roll(plain.pressure, (rows, columns), (0, 1))
    np.testing.assert_allclose(moved.pressure, expected, atol=1e-7 * plain.max_pressure)
    assert [radius * moved.tilt_x, radius * moved.tilt_y] == pytest.approx(centre, rel=1e-8)
    # At the centre of the load the bodies have approached as much as before; the approach is at the origin.
    rise = (centre[0] ** 2 + centre[1] ** 2) / (2 * radius)
    assert moved.approach + rise == pytest.approx(plain.approach, rel=1e-8)
    assert moved.indentation == pytest.approx(plain.indentation, rel=1e-7)


def test_a_symmetric_body_without_moment_does_not_tilt():
    grid = Grid.from_domain(48, 40, (-1, 1, -1, 1))
    body = ContactProblem(grid, STEEL, Paraboloid(20.0, 35.0))
    plain = solve(body, TIGHT, load=500)
    for name in ("moment", "load_centre"):
        balanced = solve(body, TIGHT, load=500, **{name: (0, 0)})
        assert abs(balanced.tilt_x) + abs(balanced.tilt_y) < 1e-9 * plain.approach
        np.testing.assert_allclose(balanced.pressure, plain.pressure, atol=1e-8 * plain.max_pressure)
        assert balanced.approach == pytest.approx(plain.approach, rel=1e-8)


def rough(n=64, **how):
    surface = SelfAffineSurface(0.8, 1.0, 0.1, (2.0, 2.0), 3, rms_slope=0.02)
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    return ContactProblem(grid, STEEL, Paraboloid(40.0, 60.0), surfaces=[surface], **how)


@pytest.mark.parametrize("hardness", [None, 4000.0])
def test_a_prescribed_tilt_moments_and_the_tilted_shape_are_one_problem(hardness):
    body, load = rough(hardness=hardness), 800.0
    moved = solve(body, TIGHT, load=load, load_centre=(0.15, -0.2))
    tilt = moved.tilt_x, moved.tilt_y
    about = solve(body, TIGHT, load=load, moment=(moved.moment_x, moved.moment_y))
    by_load, by_approach = (
        solve(body, TIGHT, tilt=tilt, **given) for given in ({"load": load}, {"approach": moved.approach})
    )
    x, y = body.grid.x(), body.grid.y()[:, None]
    shape = body.shape_on(body.grid) - tilt[0] * x - tilt[1] * y
    turned = solve(ContactProblem(body.grid, STEEL, shape, hardness=hardness), TIGHT, load=load)
    for other in (about, by_load, by_approach, turned):
        assert other.converged
        np.testing.assert_allclose(other.pressure, moved.pressure, atol=1e-6 * moved.max_pressure)
        assert other.load == pytest.approx(load, rel=1e-7)
        assert other.approach == pytest.approx(moved.approach, rel=1e-7)
        np.testing.assert_allclose(other.undeformed_distance, moved.undeformed_distance, atol=1e-9)
        assert other.indentation == pytest.approx(moved.indentation, rel=1e-6)
    assert moved.pressure_centre_x == pytest.approx(0.15, abs=1e-9)
    assert (moved.moment_x, moved.moment_y) == pytest.approx((0.15 * load, -0.2 * load), rel=1e-9)


def test_solves_do_not_depend_on_earlier_tilts():
    with ContactSolver(rough()) as solver:
        first = solver.solve(load=300)
        before = first.undeformed_distance.copy()
        solver.solve(load=300, load_centre=(0.1, 0.1))
        solver.solve(approach=first.approach, tilt=(0.01, 0.0))
        again = solver.solve(load=300)
        np.testing.assert_array_equal(again.pressure, first.pressure)
        np.testing.assert_array_equal(first.undeformed_distance, before)
        assert (again.approach, again.tilt_x, again.tilt_y) == (first.approach, 0.0, 0.0)


@pytest.mark.parametrize("hardness", [None, 4000.0])
def test_a_start_is_used_if_it_is_near(hardness):
    with ContactSolver(rough(96, hardness=hardness)) as solver:
        first = solver.solve(load=500, load_centre=(0.1, 0.1))
        assert solver.solve(load=500, load_centre=(0.1, 0.1), start=first).operator_applications < 2
        for load, centre, is_near in (
            (501, (0.1, 0.1), True),
            (900, (0.1, 0.1), False),
            (500, (-0.1, 0), False),
        ):
            plain = solver.solve(load=load, load_centre=centre)
            started = solver.solve(load=load, load_centre=centre, start=first)
            assert started.converged and (started.moment_x, started.moment_y) == pytest.approx(
                (load * centre[0], load * centre[1]), abs=1e-8 * load
            )
            np.testing.assert_allclose(started.pressure, plain.pressure, atol=1e-3 * plain.max_pressure)
            if is_near:
                assert started.operator_applications < plain.operator_applications
            else:
                np.testing.assert_allclose(started.pressure, plain.pressure, atol=1e-9 * plain.max_pressure)
                assert started.operator_applications == pytest.approx(plain.operator_applications, rel=1e-9)


def test_a_start_without_elastic_cells_is_not_used():
    with ContactSolver(rough()) as solver:
        apart = solver.solve(load=0)
        started = solver.solve(load=300, load_centre=(0.1, 0), start=apart)
        assert started.converged and started.pressure_centre_x == pytest.approx(0.1)


def test_the_tilt_stiffness_is_the_derivative_of_load_and_moments():
    body = ContactProblem(Grid.from_domain(64, 64, (-1, 1, -1, 1)), STEEL, Paraboloid(20.0, 30.0))
    grid, step = body.grid, 1e-6
    x, y = grid.x(), grid.y()[:, None]

    def carried(approach, *tilt):
        p = solver.solve(approach=approach, tilt=tilt).pressure
        return grid.cell_area * np.array([p.sum(), (p * x).sum(), (p * y).sum()])

    with warnings.catch_warnings(), ContactSolver(body, options=TIGHT) as solver:
        warnings.simplefilter("ignore")
        base = solver.solve(load=700, load_centre=(0.1, 0.2))
        stiffness = solver.with_stiffness(base, tilts=True).tilt_stiffness
        at = np.array([base.approach, base.tilt_x, base.tilt_y])
        columns = []
        for scale in np.eye(3) * (1e-2 * step, step, step):
            columns.append((carried(*(at + scale)) - carried(*(at - scale))) / (2 * scale.sum()))
        assert stiffness[0, 0] == pytest.approx(solver.stiffness(base), rel=1e-6)
    np.testing.assert_allclose(stiffness, stiffness.T)
    np.testing.assert_allclose(np.array(columns).T, stiffness, rtol=0.02, atol=0.01 * stiffness[0, 0])


def balanced_pressure(matrix, h, phi, wanted, hardness, elastic, plastic):
    """Solve for 0 <= p <= hardness with phi.T p = wanted, by pivoting from sets of cells; None if they cycle."""
    scale, seen = matrix[0, 0], set()
    matrix, h = matrix / scale, h / scale
    while (key := (elastic.tobytes(), plastic.tobytes())) not in seen:
        seen.add(key)
        cells, p = np.flatnonzero(elastic), np.where(plastic, hardness, 0.0)
        f, n = phi[cells], len(cells)
        system = np.block([[matrix[np.ix_(cells, cells)], -f], [-f.T, np.zeros((3, 3))]])
        right = np.concatenate([-h[cells] - matrix[cells] @ p, phi.T @ p - wanted])
        found = np.linalg.lstsq(system, right, rcond=None)[0] if n < 6 else np.linalg.solve(system, right)
        p[cells] = found[:n]
        gap = h + matrix @ p - phi @ found[n:]
        target = p - gap / 2
        rounding = 1e-10 * np.abs(h).max() + 1e-9 * p.max()
        above, below = p > hardness + rounding, p < -rounding
        wrong = above | below | (~elastic & ~plastic & (gap < -rounding)) | (plastic & (gap > rounding))
        if not wrong.any():
            return p
        plastic = target >= hardness
        elastic = (target > 0) & ~plastic
    return None


def random_body(rng, hard):
    """A body on at most 24 x 24 cells, with a load and its centre."""
    grid = Grid.from_domain(24, int(rng.integers(20, 25)), (-1, 1, -0.8, 0.8))
    x, y = grid.x(), grid.y()[:, None]
    shape = rng.choice([0.0, 0.01, 0.05, 0.3]) * (x**2 + rng.choice([0.3, 1.0, 3.0]) * y**2)
    shape = shape + rng.choice([0, 1e-3, 1e-2]) * rng.standard_normal(grid.shape)
    shape += rng.choice([0, 0.03]) * (x + 0.5 * y)
    holes = rng.integers(3)
    if holes:
        shape[rng.random(grid.shape) < 0.3 if holes == 1 else x**2 + y**2 > 0.5] = np.nan
    body = ContactProblem(grid, STEEL, shape, hardness=rng.choice([300.0, 1000.0, 3000.0]) if hard else None)
    possible = ~np.isnan(shape)
    load = 10 ** rng.uniform(0.5, 3.5)
    if hard:
        load = min(load, rng.choice([0.05, 0.2]) * body.hardness * grid.cell_area * possible.sum())
    weights = (rng.random(grid.shape) * possible) ** rng.choice([0.5, 1, 4])
    weights[:, : rng.choice([0, 6])] = 0
    centre = (weights * x).sum() / weights.sum(), (weights * y).sum() / weights.sum()
    return body, load, centre


@pytest.mark.parametrize("hard", [False, True])
def test_random_bodies_are_balanced_and_the_error_is_below_its_bound(hard):
    compared = 0
    for seed in range(EXAMPLES // (1 + hard)):
        body, load, centre = random_body(np.random.default_rng([seed, hard]), hard)
        solution = solve(body, load=load, load_centre=centre)
        assert solution.converged, (seed, solution.message)
        inside, grid = ~np.isnan(body.gap), body.grid
        x, y = np.broadcast_arrays(grid.x() - centre[0], grid.y()[:, None] - centre[1])
        phi = np.stack([np.ones(inside.sum()), x[inside], y[inside]], axis=1)
        p, wanted = solution.pressure[inside], np.array([load / grid.cell_area, 0, 0])
        np.testing.assert_allclose(phi.T @ p, wanted, atol=1e-9 * wanted[0])
        matrix = dense_matrix(grid, body.kernel)[np.ix_(inside.ravel(), inside.ravel())]
        plastic = solution.plastic[inside] if hard else np.zeros(p.size, bool)
        limits = np.full(p.size, body.hardness if hard else np.inf)
        exact = balanced_pressure(matrix, body.gap[inside], phi, wanted, limits, (p > 0) & ~plastic, plastic)
        if exact is not None:
            compared += 1
            error = p - exact
            rounding = 1e-9
            assert error @ matrix @ error <= (solution.error_bound + rounding) ** 2 * (p @ matrix @ p), seed
    assert compared > 0.9 * EXAMPLES // (1 + hard)
