"""Lower bound p >= p0 of the pressure, a number or an array: adhesion pulls with up to -p0.

With q = p - p0 >= 0 the gap is h + A p = (h + A p0) + A q. So q solves the contact problem with the shape h + A p0.
"""

from dataclasses import replace

import numpy as np

from app import solve
from app.halfspace.operator import InfluenceOperator


def solve_bounded(problem, lowest, method=None, **loading):
    """Return the pressure with the lower bound `lowest` [N/mm2], and the solution for p - p0.

    A prescribed `load` or `mean_pressure` is that of p. A hardness is the upper bound of p. Where contact is
    impossible, p is 0.
    """
    grid, shape = problem.grid, problem.shape_on(problem.grid)
    bound, displacement = np.where(np.isnan(shape), 0.0, lowest), np.empty(grid.shape)
    InfluenceOperator(grid, problem.kernel).product.apply(bound, displacement)
    if problem.hardness is not None:
        problem = replace(problem, hardness=problem.hardness - bound)
    if "load" in loading:
        loading["load"] -= grid.cell_area * bound.sum()
    if "mean_pressure" in loading:
        loading["mean_pressure"] -= bound.mean()
    shifted = replace(problem, gap=shape + displacement, surfaces=())
    solution = solve(shifted, method=method, **loading)
    return bound + solution.pressure, solution
