"""Solvers and states of the primal form."""

import numpy as np
import periodic
import pytest
from mpi4py import MPI
from operators import STEEL

from app.contact.distance import UndeformedDistance
from app.contact.loading import PrescribedApproach
from app.contact.prescribed_load import PrescribedLoad
from app.halfspace.grid import Grid
from app.methods.periodic.capped_state import primal_state
from app.methods.periodic.solver import PrimalSolver
from app.multigrid.hierarchy import Hierarchy
from app.options.method import read_method_file
from app.options.solver_options import SolverOptions


@pytest.fixture
def make():
    """Make solvers for grids with a share of contact."""
    solvers = []

    def solver(grid, share=0.3, seed=1, dtype=np.float32, kernel=STEEL, **options):
        hierarchy = Hierarchy(grid, kernel, MPI.COMM_SELF, dtype=dtype)
        texts = read_method_file("primal") | {name: str(text) for name, text in options.items()}
        with SolverOptions("", texts).inserted():
            solvers.append(PrimalSolver(hierarchy))
        solvers[-1].inverse.mask[...] = np.random.default_rng(seed).random(grid.shape) >= share
        solvers[-1].set_contact()
        return solvers[-1]

    yield solver
    for one in solvers:
        one.destroy()


@pytest.fixture
def steps(make):
    """Make a PrimalState under a loading, and its solver."""
    states = []

    def primal(loading, holes=0.0, nx=24, ny=16, dtype=np.float64, hardness=None):
        problem = periodic.rough(nx, ny, 3, holes)
        grid = Grid(nx, ny, problem.grid.dx, problem.grid.dy, periodic="spectral")
        solver = make(grid, dtype=dtype)
        operator = solver.inverse.influence
        upper = None if hardness is None else np.full(grid.shape, hardness)
        distance = UndeformedDistance(operator, problem.gap, hardness=upper)
        states.append(primal_state(operator, distance, solver.inverse, loading))
        states[-1].w[...] = 0
        solver.begin(states[-1])
        return states[-1], solver

    yield primal
    for one in states:
        one.destroy()


@pytest.fixture
def guessed(steps):
    """Make a PrimalState whose contact set is guessed, and its solver."""

    def guess(loading):
        primal, solver = steps(loading)
        primal.start(solver)
        primal.guess(solver)
        return primal, solver

    return guess


@pytest.fixture(params=["load", "approach"])
def loading(request):
    """A prescribed load, and an approach."""
    return PrescribedLoad(1e2) if request.param == "load" else PrescribedApproach(0.03)


@pytest.fixture
def pressure_of():
    """Compute p = B w + mean pressure from w of a state."""

    def pressure(primal, w=None):
        p = np.empty(primal.w.shape)
        primal.inverse.exact_pressure(primal.w if w is None else w, p)
        return p + primal.mean_pressure

    return pressure
