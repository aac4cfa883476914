"""Contact stiffness dF/d(approach).

It is dx dy sum(q), where q solves ``A q = 1`` on the contact set C and is 0 elsewhere. While C is fixed, the pressure p
changes by q per unit of approach. Cells enter and leave C with p = 0, so this is the exact derivative in any case.
"""

from contextlib import ExitStack

import numpy as np

from app.contact.periodic_state import contact_state
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import temporary_options

RTOL = 1e-8  # of ||A q - 1||; the error of the stiffness is smaller
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
    """Compute the stiffness of a contact set. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    distance : UndeformedDistance
        Undeformed distance on the target grid.
    contact : ndarray of bool, shape (local rows, nx)

    Returns
    -------
    float
        Stiffness [N/mm]; 0 without contact, infinite for full contact on a periodic patch, NaN if the linear solver
        does not converge.
    """
    operator, grid = hierarchy.target, hierarchy.target.grid
    state = contact_state(operator, distance)
    with ExitStack() as stack:
        stack.callback(state.destroy)
        state.contact[...] = contact
        cells = state.sum([np.count_nonzero(contact)])[0]
        if not cells or (grid.periodic and cells == grid.n):
            return np.inf if cells else 0.0
        ones = state.right
        ones.setArray(contact.reshape(-1).astype(float))
        stack.enter_context(operator.double_precision())
        stack.enter_context(temporary_options(hierarchy.prefix, {}, _OPTIONS))
        solver = LinearSolver(hierarchy, operator=operator)
        stack.callback(solver.destroy)
        solver.set_contact()
        q, iterations, failure = solver.solve(ones, np.inf)
        stiffness = grid.cell_area * q.dot(ones)
    return float(stiffness) if not failure and iterations < _MAX_IT else float("nan")
