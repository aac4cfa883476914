"""Nested iteration around any linear solver (Sec. 4.3): each grid starts from what the coarser one found."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.contact.active_set import ContactGrid
from app.contact.loop import iterate
from app.multigrid.linear_solver import DirectSolver, LinearSolver


def solve(hierarchy, shapes, approach, controls, history, nested=False, beta=0.003, target_solver=None):
    """Solve the contact problem on the target grid of a hierarchy.

    Collective. Replicated grids are solved by rank 0, which tells the others.

    Parameters
    ----------
    hierarchy : Hierarchy
    shapes : list of ndarray
        Undeformed distance at zero approach on each level (see `Hierarchy.shapes`) [mm].
    approach : float
        [mm]
    controls : Controls
    history : History
    nested : bool
        Start on the coarsest grid, else from C = {h <= 0} on the target grid.
    beta : float
        Eq. (4.1).
    target_solver : LinearSolver, optional
        Solver of the target grid, if there is one already.

    Returns
    -------
    ContactGrid, Outcome
        State of the target grid.
    """
    last = len(hierarchy.levels) - 1
    below = None
    for number in range(0 if nested else last, last + 1):
        operator = hierarchy.levels[number]
        here = operator.comm is not None or hierarchy.comm.rank == 0 or number == last
        state = ContactGrid(operator, shapes[number], operator.comm, approach)
        if below is None:
            state.start_from_interpenetration()
        else:
            _prolong(hierarchy.transfers[number], below, state, beta)
        outcome = None
        if here:
            solver = target_solver if number == last and target_solver else _solver(hierarchy, number, nested)
            outcome = iterate(state, solver, controls, history, target=number == last)
            if solver is not target_solver:
                solver.destroy()
        if operator.comm is None and hierarchy.comm.size > 1 and number < last:
            _tell(hierarchy.comm, state)
        if below is not None:
            below.destroy()
        below = state
    return state, outcome


def _solver(hierarchy, number, nested):
    operator = hierarchy.levels[number]
    comm = PETSc.COMM_SELF if operator.comm is None else PETSc.Comm(operator.comm)
    if nested and number == 0:
        return DirectSolver(operator, comm)
    return LinearSolver(hierarchy, number, comm)


def _tell(comm, state):
    """Give all ranks what rank 0 has found on a replicated grid."""
    with state.pressure as p:
        comm.Bcast(p)
    comm.Bcast(state.u)
    comm.Bcast(state.contact)


def _prolong(transfer, below, state, beta):
    """Step 2 and (3.a): p by copy, u bilinear, C = {h + u <= beta max(u)}, p = 0 outside."""
    coarse = below.pressure.getArray(readonly=True).reshape(below.u.shape)
    transfer.interpolate(below.u, state.u)
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    overlap = state.shape - state.approach
    overlap += state.u
    np.less_equal(overlap, beta * highest, out=state.contact)
    state.contact &= state.admissible
    with state.pressure as values:
        p = values.reshape(state.u.shape)
        transfer.copy(coarse, p)
        p *= state.contact
