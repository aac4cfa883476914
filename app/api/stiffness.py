"""The contact stiffness dF/d(approach), exactly: with ``A q = 1`` on C and q = 0 elsewhere it is dx dy sum(q).

While the contact set does not change, p changes by q for every unit of approach; where it does change, cells enter or
leave with p = 0, so this is the derivative all the same.
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from app.contact.periodic_state import contact_state
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import temporary_options

RTOL = 1e-8  # of ||A q - 1||; that of the stiffness is smaller still
_MAX_IT = 2000
_OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_rtol": str(RTOL),
    "ksp_atol": "0",
    "ksp_max_it": str(_MAX_IT),
    "pc_type": "python",
    "pc_python_type": "app.methods.free.circulant.Circulant",
    "pc_circulant_extend": "0",
}


def contact_stiffness(hierarchy, distance, contact):
    """Solve for the stiffness of a contact set by one more linear solve, in double precision.

    Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    distance : UndeformedDistance
        On the target grid.
    contact : ndarray of bool, shape (local rows, nx)

    Returns
    -------
    float
        [N/mm]; 0 without contact, infinite where a periodic patch is in contact everywhere, NaN if the linear solver
        does not converge.
    """
    operator, grid = hierarchy.target, hierarchy.target.grid
    state = contact_state(operator, distance)
    with ExitStack() as to_end:
        to_end.callback(state.destroy)
        state.contact[...] = contact
        cells = state.sum([np.count_nonzero(contact)])[0]
        if not cells or (grid.periodic and cells == grid.n):
            return np.inf if cells else 0.0
        ones = state.right
        ones.setArray(contact.reshape(-1).astype(float))
        to_end.enter_context(operator.double_precision())
        to_end.enter_context(temporary_options(hierarchy.prefix, {}, _OPTIONS))
        solver = LinearSolver(hierarchy, operator=operator)
        to_end.callback(solver.destroy)
        solver.set_contact()
        q, iterations, failure = solver.solve(ones, np.inf)
        stiffness = grid.cell_area * q.dot(ones)
    return float(stiffness) if not failure and iterations < _MAX_IT else float("nan")
