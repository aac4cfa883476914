"""Default method for thin, nearly incompressible layers on a rigid base."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import nnls

from app import ContactProblem, ContactSolver, Grid, InputError, Material, solve
from app.halfspace.influence import dense_matrix
from app.halfspace.operator import InfluenceOperator
from app.methods.film.membrane import Membrane
from app.problems.random_surfaces import SelfAffineSurface

PATCHES = True, False, "x", "y"
LOADINGS = {"mean_pressure": 0.3}, {"approach": -0.1}


def film(n, periodic, thickness=1.0, poisson=0.5, **options):
    surface = SelfAffineSurface(0.8, n / 4, 8, (n, n), 1, rms_slope=0.1)
    grid = Grid.from_domain(n, n, (0, n, 0, n), periodic=periodic)
    material = Material.layer(young=1.0, poisson=poisson, thickness=thickness)
    return ContactProblem(grid, material, surfaces=[surface], **options)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("periodic", PATCHES)
def test_few_products_without_the_safeguard(periodic):
    with ContactSolver(film(64, periodic)) as solver:
        assert solver.settings.type == "film"
        for mean_pressure in (0.01, 0.3, 3.0):
            solution = solver.solve(mean_pressure=mean_pressure)
            assert solution.converged
            assert not solution.fallbacks
            assert solution.operator_applications < 60
            again = solver.solve(approach=solution.approach)
            assert again.mean_pressure == pytest.approx(mean_pressure, rel=1e-3)


@pytest.mark.parametrize("poisson", [0.499, 0.5])
@pytest.mark.parametrize("cells", [(2, 66), (37, 44)])
def test_loads_just_below_full_contact_need_no_safeguard(poisson, cells):
    # On coarser grids, where the surface is smoother, all cells are in contact.
    gap = np.random.default_rng(1).uniform(0.0, 0.02, cells)
    grid = Grid(cells[1], cells[0], 1.0, 1.0, periodic=True)
    with ContactSolver(ContactProblem(grid, Material.layer(1.0, poisson, 0.5), gap)) as solver:
        full = solver.solve(mean_gap=0.0)
        assert full.contact.all()
        for fraction in (0.5, 0.9, 0.99):
            solution = solver.solve(mean_pressure=fraction * full.mean_pressure)
            assert solution.converged
            assert not solution.fallbacks
            assert solution.operator_applications < 100


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("periodic", [False, "x"])
def test_starts_at_the_hardness_cost_no_products(periodic):
    gap = np.random.default_rng(1).uniform(0.0, 0.05, (6, 40))
    grid = Grid(40, 6, 1.0, 1.0, periodic=periodic)
    with ContactSolver(ContactProblem(grid, Material.layer(1.0, 0.5, 0.4), gap, hardness=0.1)) as solver:
        first = solver.solve(mean_pressure=0.09)
        started, other = (solver.solve(mean_pressure=1e-4, start=start) for start in (first, None))
    assert started.converged
    assert started.operator_applications <= other.operator_applications + 2


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("loading", [{"mean_pressure": 1e-6}, {"approach": 1e-7}])
def test_flat_coarse_grids_are_solved(loading):
    gap = np.zeros((2, 92))
    gap[0, [3, 40, 61]] = np.nan  # coarser grids have no holes
    grid = Grid(92, 2, 1.0, 1.0, periodic=True)
    solution = solve(ContactProblem(grid, Material.layer(1.0, 0.499, 0.8), gap), **loading)
    assert solution.converged
    assert not solution.fallbacks
    np.testing.assert_array_equal(solution.contact, ~np.isnan(gap))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("periodic", PATCHES)
@pytest.mark.parametrize("loading", LOADINGS)
def test_hardness_limits_the_pressure(periodic, loading):
    solution = solve(film(64, periodic, hardness=1.0), **loading)
    assert solution.converged
    assert solution.plastic_fraction > 0
    assert solution.max_pressure <= 1.0


@pytest.mark.filterwarnings("ignore")
def test_a_solve_after_an_interrupt_equals_the_one_before(monkeypatch):
    with ContactSolver(film(64, True)) as solver:
        before = solver.solve(mean_pressure=0.3)
        apply, left = Membrane.apply, iter([False] * 5 + [True])

        def interrupted(self, pc, x, y):
            apply(self, pc, x, y)
            if self._operator.grid.nx == 64 and next(left, False):  # on the target grid
                raise KeyboardInterrupt

        monkeypatch.setattr(Membrane, "apply", interrupted)
        with pytest.raises(KeyboardInterrupt):
            solver.solve(mean_pressure=0.1)
        after = solver.solve(mean_pressure=0.3)
    assert after.iterations == before.iterations
    assert not after.fallbacks
    np.testing.assert_array_equal(after.pressure, before.pressure)


def test_half_spaces_refuse_the_preconditioner():
    grid = Grid(16, 16, 1.0, 1.0)
    options = {"ksp_type": "cg", "pc_type": "python", "pc_python_type": "app.methods.film.membrane.Membrane"}
    with pytest.raises(ValueError, match="Membrane: the bodies must be layers"):
        solve(
            ContactProblem(grid, Material.combined(1.0, 0.3), np.ones(grid.shape)),
            approach=2.0,
            options=options,
        )


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("loading", ["approach", "load"])
def test_random_problems_against_dense_solutions(seed, loading):
    rng = np.random.default_rng(seed)
    ny, nx = rng.integers(14, 20, 2)
    grid = Grid(int(nx), int(ny), 1.0, rng.uniform(0.7, 1.4))
    material = Material.layer(young=1.0, poisson=0.5, thickness=0.5)
    shape = rng.uniform(0.0, 0.1, grid.shape) + 0.02 * rng.uniform() * np.arange(nx)
    matrix = dense_matrix(grid, material.kernel)
    factor = np.linalg.cholesky(matrix)
    approach = rng.uniform(0.03, 0.2)
    p, _ = nnls(factor.T, np.linalg.solve(factor, approach - shape.reshape(-1)))
    number = approach if loading == "approach" else p.sum() * grid.cell_area
    with ContactSolver(ContactProblem(grid, material, shape)) as solver:
        assert solver.settings.type == "film"
        solution = solver.solve(**{loading: number})
    assert solution.converged
    assert solution.approach == pytest.approx(approach, rel=1e-4)
    error = solution.pressure.reshape(-1) - p
    assert error @ matrix @ error <= 1e-4 * (p @ matrix @ p)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("periodic", PATCHES)
def test_stiffness_is_the_derivative_of_the_load(periodic):
    """The tolerance covers cells that enter contact between the loads."""
    with ContactSolver(film(64, periodic, thickness=0.5), options={"lcp_rtol": 1e-9}) as solver:
        low, middle, high = (solver.solve(approach=-0.1 + step) for step in (-1e-4, 0.0, 1e-4))
        assert solver.settings.type == "film"
        secant = (high.load - low.load) / 2e-4
        assert solver.stiffness(middle) == pytest.approx(secant, rel=0.01)
        assert solver.sensitivity(middle).sum() == pytest.approx(-solver.stiffness(middle), rel=1e-5)


def test_the_preconditioner_is_symmetric_and_positive():
    grid, rng = Grid(17, 12, 1.0, 0.8), np.random.default_rng(1)
    operator = InfluenceOperator(grid, Material.layer(1.0, 0.499, 0.5).kernel, comm=MPI.COMM_SELF)
    mat, contact = operator.mat(), rng.random(grid.shape) < 0.7
    operator.mask[...] = contact
    pc = PETSc.PC().create(MPI.COMM_SELF)
    pc.setOperators(mat)
    pc.setType("python")
    pc.setPythonContext(Membrane())
    pc.setUp()
    x, y = mat.createVecs()
    columns = []
    for cell in np.flatnonzero(contact):
        x.set(0)
        x.setValue(cell, 1.0)
        x.assemble()
        pc.apply(x, y)
        columns.append(y.getArray().copy())
    inverse = np.array(columns)
    assert not inverse[:, ~contact.reshape(-1)].any()
    inverse = inverse[:, contact.reshape(-1)]
    assert abs(inverse - inverse.T).max() < 1e-12 * abs(inverse).max()
    part = dense_matrix(grid, operator.kernel)[np.ix_(contact.reshape(-1), contact.reshape(-1))]
    values = np.linalg.eigvals(inverse @ part).real
    assert values.min() > 0
    assert values.max() < 20 * values.min()


@pytest.mark.parametrize(
    ("poisson", "thickness", "thin"), [(0.5, 1, True), (0.45, 1, False), (0.5, 60, False)]
)
def test_numbers_of_the_kernel_choose_the_method(poisson, thickness, thin):
    grid = Grid(256, 256, 1.0, 1.0)
    assert Material.layer(1.0, poisson, thickness).kernel.is_thin_film(grid) is thin
    assert not Material.coated((1.0, 1e3), (poisson, 0.3), thickness).kernel.is_thin_film(grid)


def test_other_bodies_are_refused():
    problem = film(32, True, poisson=0.3)
    with pytest.raises(InputError, match="thin, nearly incompressible layers"):
        solve(problem, method="film", mean_pressure=0.1)
