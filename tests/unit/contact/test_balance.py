"""Largest loads with a prescribed centre, against linear programming."""

import histories
import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, InputError, Material
from app.contact.balance import CentredLoad, surrounds

STEEL = Material.isotropic(210e3, 0.3)


def random_body(rng):
    """A body with holes and a hardness, which may be infinite in some cells."""
    grid = Grid.from_domain(*(int(n) for n in rng.integers(2, 13, 2)), (-1, 1, -0.8, 0.8))
    gap, hardness = 1e-3 * rng.random(grid.shape), 100 * (0.1 + rng.random(grid.shape))
    if rng.random() < 0.4:
        gap[rng.random(gap.shape) < 0.4] = np.nan
        gap[0, 0] = gap[-1, -1] = 0.0
    if rng.random() < 0.3:
        hardness[rng.random(gap.shape) < 0.2] = np.inf
    return ContactProblem(grid, STEEL, gap, hardness=hardness)


@pytest.mark.mpi(1, 3)
def test_largest_load_with_a_centre(comm):
    limited = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        body, centre = random_body(rng), tuple(rng.uniform(-0.6, 0.6, 2).tolist())
        exact = histories.largest_load(body, centre)
        with ContactSolver(body, comm=comm) as solver:
            distance = solver._distances[-1]
            if not surrounds(distance, centre, solver.comm):
                assert exact == pytest.approx(0, abs=1e-6)
                continue
            most = min(exact, 1e4)
            found = CentredLoad(distance, 2 * most, centre, solver.comm).largest()
            assert found == pytest.approx(min(exact, 2 * most), rel=1e-9)
            for load in (0.3 * most, (1 - 1e-9) * most):
                assert CentredLoad(distance, load, centre, solver.comm).largest() == load
            limited += exact < np.inf
    assert limited > 4


@pytest.mark.mpi(1)
def test_a_load_that_the_hardness_cannot_carry_there_is_refused_before_work(comm):
    """A square of side 1 at a corner carries 4 H at most, and 2.25 H in a triangle with its centre in (0.5, 0.5)."""
    grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    body = ContactProblem(grid, STEEL, np.zeros(grid.shape), hardness=2000.0)
    with ContactSolver(body, comm=comm) as solver:
        products = solver.hierarchy.operator_applications()
        for loading in ({"load": 3000, "load_centre": (0.5, 0.5)}, {"load": 3000, "moment": (1500, 1500)}):
            with pytest.raises(
                InputError, match=r"load centre 0.5, 0.5 mm: the load of 3000 N must be less"
            ) as error:
                solver.solve(**loading)
        most = float(str(error.value).partition("less than ")[2].split()[0])
        assert most == pytest.approx(2250, rel=0.01)
        with pytest.raises(InputError, match="less than"):
            solver.path(load=[100, 3000], load_centre=(0.5, 0.5))
        assert solver.hierarchy.operator_applications() == products
        assert solver.solve(load=0.9 * most, load_centre=(0.5, 0.5)).converged
