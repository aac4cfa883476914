"""Patches periodic in one direction, against line contacts, many copies and dense solutions."""

from itertools import pairwise, product

import numpy as np
import pytest
from running import assert_solves_lcp, solve
from scipy.optimize import nnls

from app import ContactProblem, ContactSolver, Cylinder, Grid, InputError, Material, Sphere
from app.halfspace.love import love_coefficients
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.stress.subsurface import SubsurfaceStress, max_shear
from app.options.method import list_methods
from app.reference.line import LineContact
from app.verification.dense import DenseProblem
from app.verification.solving import UNIT, random_problem

METHODS = [name for name in list_methods() if name not in ("film", "primal")]
TIGHT = {"lcp_rtol": 1e-9}
SIDE, PERIOD, RADIUS = 2.0, 0.5, 10.0
LINE = LineContact(RADIUS, PERIOD, 1000.0, load=1000 * np.pi * PERIOD * 0.5**2 / (4 * RADIUS))  # a = 0.5


def cylinder(n, rows):
    grid = Grid.from_domain(n, rows, (-SIDE / 2, SIDE / 2, 0, PERIOD))
    return ContactProblem(grid, Material.from_contact_modulus(1000.0), Cylinder(RADIUS), periodic="y")


@pytest.mark.parametrize("rows", [1, 4])
def test_cylinder_is_the_line_contact(rows):
    """The approach is that of a line contact which does not displace the surface at twice the patch's side."""
    approach = LINE.compliance * (1 + 2 * np.log(2 * 2 * SIDE / LINE.a))
    errors = []
    for n in (32, 64, 128):
        solution = solve(cylinder(n, rows), None, "norm", load=LINE.load, **TIGHT)
        x = np.abs(solution.grid.x()) / LINE.a
        pressure = LINE.max_pressure * np.sqrt(np.maximum(1 - x**2, 0))
        assert abs(solution.contact.sum(axis=1) / n * SIDE / 2 - LINE.a).max() <= SIDE / n / 2
        assert np.ptp(solution.pressure, axis=0).max() <= 1e-6 * LINE.max_pressure
        away = np.abs(x - 1) > 0.2
        errors.append(
            [
                abs(solution.max_pressure / LINE.max_pressure - 1),
                abs(solution.approach / approach - 1),
                np.abs(solution.pressure - pressure)[:, away].max() / LINE.max_pressure,
            ]
        )
        assert solution.load == pytest.approx(LINE.load, rel=1e-9)
    errors = np.array(errors)
    assert (errors[1:, 1:] < errors[:-1, 1:] / 2.5).all() and (
        errors[:, 0] < 0.1 / np.array([32, 64, 128])
    ).all()


def wavy(x, y):
    return x**2 / 4 + 0.02 * (1 - np.cos(2 * np.pi * y))


def test_middle_of_copies_tends_to_it_with_the_square_of_their_number():
    n, errors = 8, []
    one = ContactProblem(Grid.from_domain(n, n, (-0.5, 0.5, 0, 1), "y"), UNIT, wavy)
    for m in (2, 4, 8):
        copies = Grid.from_domain(n, n * (2 * m + 1), (-0.5, 0.5, -m, m + 1))
        middle = solve(ContactProblem(copies, UNIT, wavy), 0.06, "norm", **TIGHT).pressure[
            m * n : (m + 1) * n
        ]
        alone = solve(one, None, "norm", load=middle.sum() * copies.cell_area, **TIGHT).pressure
        errors.append(np.abs(alone - middle).max() / middle.max())
    assert errors[0] < 5e-3
    assert all(3 < one / two < 5 for one, two in pairwise(errors))


def matrix_of_copies(grid):
    """Influence matrix of a patch periodic in y: Love's coefficients of 401 copies, and the rest as lines of force."""
    (ny, nx), copies = grid.shape, 200
    period, datum = ny * grid.dy, patch_kernel(UNIT.kernel, grid).datum
    first, end = np.zeros(grid.shape), (copies + 0.5) * period
    for copy in range(-copies, copies + 1):
        distances = np.abs(np.arange(ny) + copy * ny)
        first += love_coefficients((grid.dx, grid.dy), UNIT.kernel.compliance, distances, nx)
    x = np.arange(nx) * grid.dx
    line = np.log((end + np.hypot(end, x)) / datum)
    first -= UNIT.kernel.compliance * grid.cell_area * 2 / period * line
    j, i = np.arange(ny), np.arange(nx)
    dj, di = np.abs(j[:, None] - j), np.abs(i[:, None] - i)
    return first[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)


@pytest.mark.parametrize("seed", range(8))
def test_random_problems_equal_dense_solutions(seed):
    rng = np.random.default_rng(seed)
    nx, ny = rng.integers(2, 14, 2)
    along_y = random_problem(rng, nx, ny, "y")
    grid, gap = along_y.grid, along_y.gap
    inside = ~np.isnan(gap.ravel())
    matrix = matrix_of_copies(grid)[np.ix_(inside, inside)]
    approach = np.nanmin(gap) + rng.uniform(0.2, 1.0) * (np.nanmax(gap) - np.nanmin(gap))
    h, factor = gap.ravel()[inside] - approach, np.linalg.cholesky(matrix)
    expected = np.zeros(grid.n)
    expected[inside] = nnls(factor.T, -np.linalg.solve(factor, h))[0]  # least p.Ap / 2 + h.p of p >= 0
    expected = expected.reshape(grid.shape)
    close = {"rtol": 0, "atol": 2e-5 * expected.max()}
    if seed % 2:
        other = Grid(grid.ny, grid.nx, grid.dy, grid.dx, periodic="x")
        along_y, expected = ContactProblem(other, UNIT, gap.T), expected.T
    for method in METHODS:
        solution = solve(along_y, approach, method, **TIGHT)
        assert_solves_lcp(solution)
        np.testing.assert_allclose(solution.pressure, expected, **close)
    with ContactSolver(along_y, None, {"lcp_type": "snesvi"}) as solver:
        np.testing.assert_allclose(solver.solve(approach=approach).pressure, expected, **close)
    load = expected.sum() * grid.cell_area
    np.testing.assert_allclose(solve(along_y, None, "fast", load=load, **TIGHT).pressure, expected, **close)


@pytest.mark.parametrize("seed", range(6))
def test_random_layers_equal_dense_solutions(seed):
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, *rng.integers(3, 15, 2), "xy"[seed % 2])
    side, substrate = max(problem.grid.shape) * 0.1, [0.1, 10.0, np.inf][seed % 3]
    material = Material.coated((1.0, substrate), (0.4, 0.3), side * 10 ** rng.uniform(-4, 1))
    problem = ContactProblem(problem.grid, material, problem.gap)
    approach = np.nanmin(problem.gap) + rng.uniform(0.2, 1.0) * np.nanmean(problem.gap)
    dense = DenseProblem(problem)
    expected = dense.at(approach)
    for method in ("fast", "fmg_v11", "norm"):
        solution = solve(problem, approach, method, **TIGHT)
        assert_solves_lcp(solution)
        error = dense.energy(solution.pressure - expected)
        assert error <= (solution.error_bound + 1e-12) * dense.energy(expected)
        np.testing.assert_allclose(solution.pressure, expected, rtol=0, atol=1e-4 * expected.max())


STIFF_CASES = [
    *product([0.1, 1.0, 2.0, 30.0], [(32, 32), (40, 24)], ["load", "approach", "hard"]),
    *((contrast, (16, 70), "load") for contrast in (2.0, 30.0)),
    *((contrast, (64, 64), loading) for contrast in (2.0, 30.0) for loading in ("load", "hard")),
]


@pytest.mark.parametrize(("contrast", "shape", "loading"), STIFF_CASES)
def test_coated_bodies_are_solved_alike_in_both_directions(contrast, shape, loading):
    """A stiff coating of contrast 2 is padded past the free boundary only, whichever direction this is."""
    (ny, nx), half = shape, shape[0] / shape[1]
    grids = {
        "y": Grid.from_domain(nx, ny, (-1, 1, -half, half), "y"),
        "x": Grid.from_domain(ny, nx, (-half, half, -1, 1), "x"),
    }
    material = Material.coated((contrast * 1e5, 1e5), (0.3, 0.3), 0.2)
    prescribed = {"approach": 0.01} if loading == "approach" else {"load": 100.0}
    found = {}
    for periodic, grid in grids.items():
        problem = ContactProblem(grid, material, Sphere(10.0), hardness=500.0 if loading == "hard" else None)
        with ContactSolver(problem, "fast", {"lcp_rtol": 1e-8}) as solver:
            found[periodic] = solver.solve(**prescribed)
        assert found[periodic].converged and found[periodic].fallbacks == 0
        assert found[periodic].error_bound < 1e-4
    along_x, along_y = found["x"], found["y"]
    close = {"rtol": 0, "atol": 1e-5 * along_y.max_pressure}
    np.testing.assert_allclose(along_x.pressure.T, along_y.pressure, **close)
    assert along_x.approach == pytest.approx(along_y.approach, rel=1e-6)
    assert along_x.operator_applications < 1.3 * along_y.operator_applications + 5


def rough_gap(ny, nx, seed=0):
    rng = np.random.default_rng(seed)
    x, y = 2 * np.pi * np.arange(nx) / nx, 2 * np.pi * np.arange(ny)[:, None] / ny
    waves = [
        rng.normal() / (1 + kx**2 + ky**2) * np.cos(kx * x + ky * y + rng.uniform(0, 6))
        for kx in range(6)
        for ky in range(-6, 7)
    ]
    return 0.02 * (sum(waves) - np.min(sum(waves)))


@pytest.mark.parametrize(
    ("method", "shape"),
    [*product(["fast", "fmg_v11", "norm"], [(40, 36), (35, 33)]), ("fast", (150, 136))],
)
def test_shifted_heights_shift_pressures_and_transposed_ones_transpose_them(method, shape):
    (ny, nx), gap = shape, rough_gap(*shape)
    grid = Grid(nx, ny, 0.1, 0.13, periodic="y")
    transposed = Grid(ny, nx, 0.13, 0.1, periodic="x")
    problems = [ContactProblem(grid, UNIT, gap), ContactProblem(grid, UNIT, np.roll(gap, 1, axis=0))]
    problems.append(ContactProblem(transposed, UNIT, gap.T))
    solutions = []
    for problem in problems:
        with ContactSolver(problem, method, TIGHT) as solver:
            solutions.append(solver.solve(mean_pressure=0.02))
    first, shifted, turned = solutions
    assert_solves_lcp(first)
    assert first.error_bound < 1e-5
    for other in (np.roll(shifted.pressure, -1, axis=0), turned.pressure.T):
        np.testing.assert_allclose(other, first.pressure, rtol=0, atol=1e-6 * first.max_pressure)
    for name in ("approach", "load", "perimeter", "contact_area", "mean_gap", "rms_slope"):
        assert getattr(first, name) == pytest.approx(getattr(shifted, name), rel=1e-6)
        assert getattr(first, name) == pytest.approx(getattr(turned, name), rel=1e-6)
    assert first.pressure_centre_x == pytest.approx(turned.pressure_centre_y, rel=1e-6)
    assert np.isnan([first.pressure_centre_y, first.moment_y, first.semi_axis_major]).all()
    np.testing.assert_allclose(first.contact_patches(), turned.contact_patches(), rtol=1e-12)
    np.testing.assert_allclose(first.contact_patches(), shifted.contact_patches(), rtol=1e-12)


def test_plastic_cells_and_unloading():
    grid = Grid(36, 40, 0.1, 0.13, periodic="y")
    problem = ContactProblem(grid, UNIT, rough_gap(40, 36))
    elastic = solve(problem, 0.02, "fast", **TIGHT)
    capped = ContactProblem(grid, UNIT, problem.gap, hardness=0.6 * elastic.max_pressure)
    solutions = [solve(capped, None, method, load=elastic.load, **TIGHT) for method in ("fast", "fmg_v11")]
    one, other = solutions
    assert 0 < one.plastic_fraction < 1
    np.testing.assert_allclose(one.pressure, other.pressure, rtol=0, atol=1e-6 * one.max_pressure)
    again = ContactProblem(grid, UNIT, problem.gap, surfaces=[one.residual_surface()])
    unloaded = solve(again, None, "fast", load=elastic.load, **TIGHT)
    np.testing.assert_allclose(unloaded.pressure, one.pressure, rtol=0, atol=1e-5 * one.max_pressure)


def test_stiffness_is_the_derivative_of_the_load():
    problem = ContactProblem(Grid(36, 40, 0.1, 0.13, periodic="y"), UNIT, rough_gap(40, 36))
    with ContactSolver(problem, "norm", TIGHT) as solver:
        stiffness = solver.stiffness(solver.solve(approach=0.02))
        low, high = (solver.solve(approach=0.02 + step) for step in (-1e-7, 1e-7))
    assert stiffness == pytest.approx((high.load - low.load) / 2e-7, rel=1e-4)


def test_stress_below_a_line_contact():
    """The largest shear stress, 0.30 of the largest pressure at a depth of 0.79 a (Johnson 1985, Sec. 4.2)."""
    solution = solve(cylinder(128, 4), None, "norm", load=LINE.load, **TIGHT)
    below = SubsurfaceStress(solution.pressure, solution.grid, 0.3)
    sheared = below.maxima()[1]
    assert sheared.max_shear == pytest.approx(0.3003 * LINE.max_pressure, rel=5e-3)
    assert sheared.depth == pytest.approx(0.7861 * LINE.a, rel=2e-2)
    depths = np.array([0.1, 0.5, 1.0])
    stress = below.line(depths, 0.0, 0.2)
    root = np.sqrt(LINE.a**2 + depths**2)
    exact_x = -LINE.max_pressure / LINE.a * ((LINE.a**2 + 2 * depths**2) / root - 2 * depths)
    exact_z = -LINE.max_pressure * LINE.a / root
    np.testing.assert_allclose(stress[0], exact_x, atol=2e-3 * LINE.max_pressure)
    np.testing.assert_allclose(stress[2], exact_z, atol=2e-3 * LINE.max_pressure)
    np.testing.assert_allclose(stress[1], 0.3 * (exact_x + exact_z), atol=2e-3 * LINE.max_pressure)
    assert max_shear(stress[:, 1]) > 0


@pytest.mark.parametrize("direction", ["x", "y"])
def test_stress_is_that_of_many_copies(direction):
    """Far copies act as lines of force, so that the error falls with the number of copies."""
    x, y = (np.arange(24) + 0.5) / 24, (np.arange(16)[:, None] + 0.5) / 16
    pressure = np.sin(np.pi * x) ** 4 * (1.2 + np.cos(2 * np.pi * y))
    grid, errors = Grid(24, 16, 1 / 24, 1 / 16, periodic="y"), []
    for m in (8, 32):
        copies = Grid(24, 16 * (2 * m + 1), 1 / 24, 1 / 16, y0=-m)
        free = SubsurfaceStress(np.tile(pressure, (2 * m + 1, 1)), copies, 0.3).plane(0.3)
        if direction == "y":
            stress = SubsurfaceStress(pressure, grid, 0.3).plane(0.3)
        else:
            turned = SubsurfaceStress(pressure.T, Grid(16, 24, 1 / 16, 1 / 24, periodic="x"), 0.3)
            stress = turned.plane(0.3)[[1, 0, 2, 3, 5, 4]].transpose(0, 2, 1)
            section = turned.section([0.3], x=turned.grid.x()[3])[:, 0]
            np.testing.assert_allclose(section, turned.plane(0.3)[:, :, 3], atol=1e-13)
        errors.append(np.abs(stress - free[:, 16 * m : 16 * (m + 1)]).max())
    assert errors[0] < 0.05 and errors[1] < errors[0] / 2.5


def test_what_needs_both_directions_is_refused():
    problem = cylinder(8, 4)
    with pytest.raises(InputError, match="mean_gap: only on a periodic patch, in x and y"):
        ContactSolver(problem).solve(mean_gap=1.0)
    with pytest.raises(InputError, match="-lcp_type primal: works on patches periodic in x and y"):
        ContactSolver(problem, "primal")
    with pytest.raises(InputError, match="one cell wide"):
        ContactProblem(Grid(8, 1, 0.1, 0.1), problem.material, Cylinder(RADIUS), periodic="x")
