"""Conjugate gradients of the primal form."""

import numpy as np
import periodic
import pytest
from mpi4py import MPI
from operators import STEEL
from petsc4py import PETSc

from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.contact.prescribed_load import PrescribedLoad
from app.halfspace.grid import Grid
from app.methods.periodic.solver import PrimalSolver
from app.methods.periodic.state import PrimalState
from app.multigrid.hierarchy import Hierarchy
from app.options.method import read_method_file
from app.options.solver_options import SolverOptions


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


def test_flops_of_carrying_cg_are_logged(steps):
    primal, solver = guessed(steps, PrescribedLoad(1e2))
    inverse = primal.inverse
    products, before = inverse.product.count, PETSc.Log.getFlops()
    iterations, *_ = solver.improve(primal, 0.0)
    flops = PETSc.Log.getFlops() - before - (inverse.product.count - products) * inverse.product.flops
    assert flops >= 10 * iterations * inverse.grid.n > 0


@pytest.mark.parametrize("count", [1, 2, 5])
def test_steps_are_those_of_flexible_cg(steps, count):
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
