"""Surface compliance of each cell: random problems against the dense solver, limits, and everything derived."""

from dataclasses import replace

import numpy as np
import pytest
from petsc4py import PETSc

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, read_result, refine
from app.base.mpi import MPI
from app.contact.certificate import certify
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.halfspace.operator import InfluenceOperator
from app.options.method import read_method_file
from app.verification.dense import DenseProblem
from app.verification.solving import approach_at, random_problem, solved, with_hardness

pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")
STEEL = Material.combined(80000, 0.3)
COATED = Material.coated((4e5, 2e5), (0.2, 0.3), 0.1)
LAYER = Material.layer(5.0, 0.3, 0.2)
TIGHT = {"lcp_rtol": 1e-9, "lcp_error_bound": 1e-7}
GRID = Grid.from_domain(24, 20, (-0.4, 0.4, -0.4, 0.4))
each_patch = pytest.mark.parametrize("periodic", [None, True, "x"])


def random_compliance(rng, problem):
    """Return the problem with a compliance of cells or of blocks, small or large against A."""
    ny, nx = problem.grid.shape
    blocks = (np.add.outer(np.arange(ny) // 4, np.arange(nx) // 4) % 2).astype(float)
    share = rng.random((ny, nx)) if rng.random() < 0.5 else blocks
    top = problem.kernel.smallest_eigenvalue(problem.grid) * 10 ** rng.uniform(-2, 4)
    compliance = top * 10.0 ** (rng.choice([0.3, 1, 3, 5]) * (share - 1))
    if rng.random() < 0.4:
        compliance[share < 0.5] = 0
    return replace(problem, surface_compliance=compliance)


def ball(periodic=None, compliance=None, **options):
    """Return a ball, with a random compliance up to ten times the smallest eigenvalue of A."""
    problem = ContactProblem(GRID, STEEL, Sphere(10).shape_on(GRID), periodic=periodic, **options)
    if compliance is None:
        rng = np.random.default_rng(1)
        compliance = 10 * problem.kernel.smallest_eigenvalue(problem.grid) * rng.random(GRID.shape)
    return replace(problem, surface_compliance=compliance)


@pytest.mark.parametrize("periodic", ["", "spectral", "love", "x", "y"])
@pytest.mark.parametrize("kind", ["approach", "load", "mean_pressure"])
def test_random_problems_against_the_dense_solver(periodic, kind):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = random_compliance(rng, random_problem(rng, *map(int, rng.integers(2, 21, 2)), periodic))
        approach = approach_at(problem, rng.choice([0.05, 0.3, 0.8, 2.0]))
        if rng.random() < 0.35:
            problem = with_hardness(rng, problem, float(DenseProblem(problem).at(approach).max()))
        dense, grid = DenseProblem(problem), problem.grid
        exact = dense.at(approach)
        number = approach if kind == "approach" else float(exact.sum()) * grid.cell_area
        if kind != "approach":
            exact, _ = dense.under(number, approach)
        found = solved(problem, **{kind: number / (grid.area if kind == "mean_pressure" else 1)})
        size = dense.energy(found.pressure)
        assert found.converged and found.error_bound < 0.01
        assert dense.energy(found.pressure - exact) <= (found.error_bound + 1e-13) * size


@pytest.mark.parametrize("periodic", ["", "spectral", "love", "y"])
def test_the_bound_holds_for_any_pressure(periodic):
    rng = np.random.default_rng(6)
    for _ in range(6):
        problem = random_compliance(rng, random_problem(rng, 12, 10, periodic))
        approach = approach_at(problem, rng.choice([0.1, 0.7, 2.0]))
        dense, operator = DenseProblem(problem), InfluenceOperator(problem.grid, problem.kernel)
        exact, operator.compliance = dense.at(approach), problem.compliance
        state = contact_state(operator, UndeformedDistance(operator, problem.gap))
        state.approach = approach
        for size in (0.0, 1e-12, 1e-6, 1e-3, 0.1, 10.0):
            noise = size * float(exact.max()) * rng.normal(size=exact.shape)
            state.values[...] = np.where(state.admissible, exact + noise, 0)
            state.project()
            state.compute_displacement()
            error = dense.energy(state.p - exact) / dense.energy(state.p)
            assert error <= certify(state).error_bound * (1 + 1e-9)


@each_patch
@pytest.mark.parametrize("size", [1e-7, 1e-5])
def test_a_nearly_constant_field_is_the_number(periodic, size):
    number, field = ball(periodic, size), np.full(GRID.shape, size)
    assert ball(periodic, field).surface_compliance == size
    field[3, 4] *= 1 + 1e-12
    for loading in ({"load": 50}, {"mean_gap": 2e-3} if periodic is True else {"approach": 3e-3}):
        one = solved(number, options=TIGHT, **loading)
        other = solved(ball(periodic, field), options=TIGHT, **loading)
        assert other.approach == pytest.approx(one.approach, rel=1e-6)
        assert other.mean_gap == pytest.approx(one.mean_gap, rel=1e-6)
        for name in ("pressure", "displacement", "gap"):
            expected = getattr(one, name)
            np.testing.assert_allclose(getattr(other, name), expected, atol=1e-5 * np.abs(expected).max())


@each_patch
def test_limits(periodic):
    share = np.random.default_rng(0).uniform(0.5, 2, GRID.shape)
    stiff, tiny = (solved(ball(periodic, c), load=50, options=TIGHT) for c in (0, 1e-15 * share))
    np.testing.assert_allclose(tiny.pressure, stiff.pressure, atol=1e-5 * stiff.max_pressure)
    found = solved(ball(periodic, share), approach=0.01)
    winkler = np.maximum(0.01 - Sphere(10).shape_on(GRID), 0) / share
    np.testing.assert_allclose(found.pressure, winkler, atol=1e-4 * winkler.max())


@each_patch
@pytest.mark.parametrize("share", ["halves", "cells"])
def test_strong_contrasts_need_no_safeguard(periodic, share):
    """Also in windows, in single precision, and on several levels."""
    grid, rng = Grid.from_domain(150, 150, (-0.4, 0.4, -0.4, 0.4)), np.random.default_rng(2)
    soft = grid.x() > grid.y()[:, None] if share == "halves" else rng.random(grid.shape) > 0.5
    problem = ContactProblem(grid, STEEL, Sphere(10), periodic=periodic)
    compliance = 1000 * problem.kernel.smallest_eigenvalue(problem.grid) * soft
    found = solved(replace(problem, surface_compliance=compliance), load=20)
    whole = {"lcp_window": 0, "lcp_precision": "double"} | TIGHT
    other = solved(replace(problem, surface_compliance=compliance), load=20, options=whole)
    assert found.converged and found.fallbacks == 0 and found.inner_iterations < 100
    assert found.approach == pytest.approx(other.approach, rel=1e-4)
    np.testing.assert_allclose(found.pressure, other.pressure, atol=2e-3 * other.max_pressure)


@pytest.mark.parametrize("periodic", [None, True, "y"])
@pytest.mark.parametrize("material", [COATED, LAYER], ids=["coated", "layer"])
def test_layers(periodic, material):
    stiff = ContactProblem(GRID, material, Sphere(10).shape_on(GRID), periodic=periodic)
    own = stiff.kernel.self_displacement(stiff.grid)
    share = np.random.default_rng(4).random(GRID.shape)
    problem = replace(stiff, surface_compliance=5 * own * share)
    dense, load = DenseProblem(problem), 0.1 if material is LAYER else 50
    found = solved(problem, load=load, options=TIGHT)
    uniform = stiff.kernel.uniform_compliance(stiff.grid) * found.mean_pressure
    exact, approach = dense.under(load, found.approach - uniform)
    assert found.approach - uniform == pytest.approx(approach, rel=1e-6)
    assert dense.energy(found.pressure - exact) <= found.error_bound * dense.energy(exact) * (1 + 1e-6)
    assert solved(problem, approach=found.approach).load == pytest.approx(load, rel=1e-4)


# -- what is derived from solutions ----------------------------------------------------------------------


@each_patch
def test_implicit_wear_against_dense_steps(periodic):
    problem = ball(periodic)
    k = problem.surface_compliance[::-1] * (np.random.default_rng(0).random(GRID.shape) > 0.3)
    with ContactSolver(problem, options=TIGHT) as solver:
        path = solver.wear(k, 6, 3, load=50)
        solutions, worn = list(path), np.zeros(GRID.shape)
    for found in solutions:
        step = replace(problem, gap=problem.gap + worn, surface_compliance=problem.surface_compliance + 2 * k)
        exact, approach = DenseProblem(step).under(50, found.approach)
        worn = worn + 2 * k * exact.astype(float)
        assert found.approach == pytest.approx(approach, rel=1e-6)
        np.testing.assert_allclose(found.worn_depth, worn, atol=1e-6 * worn.max())
        assert found.worn_volume == pytest.approx(worn.sum() * GRID.cell_area, rel=1e-6)
        np.testing.assert_allclose(
            found.undeformed_distance, problem.gap + found.worn_depth - found.approach, atol=1e-15
        )
        assert np.array_equal(found.surface_compliance, problem.surface_compliance)


@each_patch
def test_stiffness_and_sensitivities_are_differences(periodic):
    problem, rng = ball(periodic), np.random.default_rng(7)
    kinds = {"approach": "load", "load": "approach"} | ({"mean_gap": None} if periodic is True else {})
    with ContactSolver(problem, options={"lcp_rtol": 1e-11, "lcp_error_bound": 1e-9}) as solver:
        first = solver.solve(load=50)
        stiffness, weights = solver.stiffness(first), first.contact * rng.random(GRID.shape)
        lower, upper = (solver.solve(approach=first.approach + s * 1e-8) for s in (-1, 1))
        assert stiffness == pytest.approx((upper.load - lower.load) / 2e-8, rel=1e-4)
        assert solver.with_stiffness(first).conductance_width is None
        change, size = rng.random(GRID.shape), 1e-9
        for fixed, name in kinds.items():
            number = getattr(first, fixed)
            at = solver.solve(**{fixed: number})
            for of, value in ((name, None), (weights, weights)):
                if of is None:
                    continue
                expected = float((solver.sensitivity(at, of) * change).sum())
                ends = []
                for sign in (-1, 1):
                    solver.update(replace(problem, gap=problem.gap + sign * size * change))
                    end = solver.solve(**{fixed: number})
                    assert np.array_equal(end.contact, at.contact)
                    ends.append(getattr(end, name) if value is None else (value * end.pressure).sum())
                solver.update(problem)
                assert (ends[1] - ends[0]) / (2 * size) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("share", [0.99, 0.5, 0.01, 1e-4])
def test_a_mean_gap_is_met(share):
    problem = ball(True)
    touching = float(problem.gap.mean() - problem.gap.min())
    found = solved(problem, mean_gap=share * touching)
    rtol = 1.1 * min(1e-5 / share, 1e-2)
    assert found.converged and found.mean_gap == pytest.approx(share * touching, rel=rtol)
    again = solved(problem, approach=found.approach)
    assert again.load == pytest.approx(found.load, rel=1e-4)
    assert solved(problem, mean_gap=2 * touching).load == 0


def test_full_contact_of_a_periodic_patch_has_no_largest_approach():
    problem = ball(True)
    with ContactSolver(problem) as solver:
        found = solver.solve(approach=0.1)
        stiffness = solver.stiffness(found)
        more = solver.solve(approach=0.11)
    assert found.contact.all() and found.converged and found.error_bound < 1e-4
    assert more.load - found.load == pytest.approx(0.01 * stiffness, rel=1e-5)


@each_patch
def test_a_background_pressure_displaces_the_springs(periodic):
    problem = ball(periodic)
    background = 5 + np.random.default_rng(0).random(GRID.shape)
    found = solved(replace(problem, background_pressure=background), load=50, options=TIGHT)
    net = replace(
        problem,
        gap=problem.gap + (DenseProblem(problem).matrix @ background.ravel()).reshape(GRID.shape),
    )
    exact = DenseProblem(net).at(found.approach)
    np.testing.assert_allclose(found.pressure - background, exact, atol=1e-5 * found.max_pressure)


def test_bodies_tilt():
    found = solved(ball(), load=50, load_centre=(0.02, 0.01), options=TIGHT)
    tilt = found.tilt_x * GRID.x() + found.tilt_y * GRID.y()[:, None]
    turned = ball()
    exact = DenseProblem(replace(turned, gap=turned.gap - tilt)).at(found.approach)
    assert found.converged and found.moment_x == pytest.approx(1.0) and found.moment_y == pytest.approx(0.5)
    np.testing.assert_allclose(found.pressure, exact, atol=1e-4 * found.max_pressure)


# -- files, matrices and refusals ------------------------------------------------------------------------


def test_results_have_the_field(tmp_path):
    problem = ball()
    found = solved(problem, load=50)
    found.save(tmp_path / "ball.h5")
    read = read_result(tmp_path / "ball.h5")
    assert np.array_equal(read.surface_compliance, problem.surface_compliance)
    assert read.units["surface_compliance"] == "mm3/N" and "surface_compliance" not in found.problem
    assert "\n  surface compliance of each cell\n" in found.summary()
    wider = ContactProblem(GRID, STEEL, problem)
    assert np.array_equal(wider.surface_compliance, problem.surface_compliance)


def test_the_mat_has_the_compliance_on_its_diagonal():
    problem = ball()
    operator = InfluenceOperator(problem.grid, problem.kernel)
    operator.compliance, mat = problem.compliance, operator.mat()
    dense = DenseProblem(problem).matrix
    x, y = mat.createVecs()
    x.setRandom()
    mat.mult(x, y)
    np.testing.assert_allclose(y.array, dense @ x.array, rtol=1e-9)
    np.testing.assert_allclose(mat.getDiagonal().array, np.diag(dense), rtol=1e-12)
    np.testing.assert_allclose(operator.matrix(), dense, rtol=1e-9, atol=1e-9 * dense.max())
    assert mat.norm(PETSc.NormType.INFINITY) == pytest.approx(np.abs(dense).sum(axis=1).max())
    for vec in (x, y, mat):
        vec.destroy()


FAST = {k: v for k, v in read_method_file("fast").items() if not k.startswith("pc")}
WRONG = np.ones(GRID.shape)
WRONG[3, 4] = -1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ball(None, WRONG), "surface_compliance: -1 in row 3, column 4; must be 0, or"),
        (lambda: ball(None, WRONG * np.nan), "surface_compliance: nan in row 0, column 0; must be 0, or"),
        (lambda: ball(None, WRONG[1:]), r"has shape \(19, 24\); the grid needs"),
        (lambda: solved(ball(), "norm", load=5), "-lcp_type active_set: not with a surface compliance that"),
        (
            lambda: solved(ball(), options=FAST | {"pc_type": "mg"}, load=5),
            "Gauss-Seidel sweeps .* not with a surface compliance that varies",
        ),
        (lambda: solved(ball(True), mean_gap=0), "mean_gap 0: must be above 0 mm with a surface compliance"),
        (
            lambda: refine(ball(), until=0.1, load=5),
            "a surface compliance known on its grid only; must be a number",
        ),
        (
            lambda: ContactSolver(ball()).update(ball(None, 0)),
            "must be a ContactProblem of the solver's grid",
        ),
        (lambda: ContactSolver(ball()).wear(-WRONG, 1, 1, load=5), "coefficient: -1 in row 0, column 0"),
    ],
)
def test_what_is_not_allowed_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.mpi(2)
@pytest.mark.parametrize("periodic", [None, True])
def test_ranks_agree(comm, periodic):
    grid = Grid.from_domain(96, 90, (-0.4, 0.4, -0.4, 0.4))
    stiff = ContactProblem(grid, STEEL, Sphere(10), periodic=periodic, surfaces=[ripples(grid)])
    share = np.random.default_rng(3).random(grid.shape)
    problem = replace(stiff, surface_compliance=10 * stiff.kernel.smallest_eigenvalue(stiff.grid) * share)
    options = {"lcp_cells_per_rank": 64} | TIGHT
    with ContactSolver(problem, options=options, comm=comm) as solver:
        shared = solver.solve(load=20), *solver.wear(1e-9 * share, 100, 1, load=20)
    shared = [found.gather() for found in shared]
    if comm.rank == 0:
        with ContactSolver(problem, options=options, comm=MPI.COMM_SELF) as solver:
            alone = solver.solve(load=20), *solver.wear(1e-9 * share, 100, 1, load=20)
        for one, other in zip(shared, alone, strict=True):
            assert one.converged and one.approach == pytest.approx(other.approach, rel=1e-8)
            np.testing.assert_allclose(one.pressure, other.pressure, atol=1e-5 * other.max_pressure)


def ripples(grid):
    """Return heights with asperities of a few cells."""
    return 1e-5 * np.cos(40 * grid.x()) * np.cos(50 * grid.y())[:, None]
