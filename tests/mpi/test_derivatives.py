"""Sensitivities against finite differences, on one and two ranks."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material
from app.base.mpi import MPI

OPTIONS = {"lcp_rtol": 1e-13, "lcp_precision": "double"}


def make_problem(periodic, change=0.0, hardness=None):
    """Return a bumpy body; `change` is added to its shape."""
    grid = Grid.from_domain(24, 20, (-0.5, 0.5, -0.4, 0.4))
    x, y = grid.x(), grid.y()[:, None]
    smooth = -0.01 * np.cos(2 * np.pi * x) * np.cos(2.5 * np.pi * y) if periodic else (x**2 + 2 * y**2) / 20
    shape = smooth + 0.001 * np.random.default_rng(1).random(grid.shape) + change
    return ContactProblem(grid, Material.from_contact_modulus(1000.0), shape, periodic, hardness=hardness)


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize(
    ("periodic", "loading"),
    [
        (False, {"load": 0.5}),
        (False, {"approach": 0.005}),
        (True, {"load": 1.0}),
        (True, {"approach": -0.005}),
        (True, {"mean_gap": 0.005}),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else ("free", "periodic")[value],
)
@pytest.mark.parametrize("hardness", [None, 15.0], ids=["elastic", "plastic"])
def test_sensitivities_are_derivatives(comm, periodic, loading, hardness):
    change, weight = np.random.default_rng(2).random((2, 20, 24))
    step = 1e-8
    with ContactSolver(make_problem(periodic, 0.0, hardness), options=OPTIONS, comm=comm) as solver:

        def total(field):
            return comm.allreduce(float(np.sum(field)), MPI.SUM)

        def energy(solution):
            return total(weight[solution.slabs.rows] * solution.pressure**2) / 2

        def difference(number, **loading):
            solutions = []
            for sign in (-1, 1):
                solver.update(make_problem(periodic, sign * step * change, hardness))
                solutions.append(solver.solve(**loading))
                assert not total(solutions[-1].contact != solution.contact)
                assert not total(solutions[-1].plastic != solution.plastic)
            low, high = map(number, solutions)
            return (high - low) / (2 * step)

        solution = solver.solve(**loading)
        local = weight[solution.slabs.rows] * solution.pressure
        computed = [total(change[solution.slabs.rows] * solver.sensitivity(solution, of)) for of in
                    ("load", "approach", local)]  # fmt: skip
        whole = comm.allgather(local)
        again = solver.sensitivity(solution, np.concatenate(whole))
        np.testing.assert_array_equal(again, solver.sensitivity(solution, local))
        expected = [
            difference(lambda solution: solution.load, approach=solution.approach),
            difference(lambda solution: solution.approach, load=solution.load),
            difference(energy, **loading),
        ]
    assert computed == pytest.approx(expected, rel=1e-6)
