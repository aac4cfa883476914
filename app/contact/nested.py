"""Nested iteration around any linear solver (Sec. 4.3): each grid starts from what the coarser one found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.contact.framing import Frame
from app.contact.loading import PrescribedApproach
from app.contact.loop import SINGLE_EXHAUSTED, WANDERS, iterate
from app.halfspace.reductions import sum_over
from app.multigrid.circulant import circulant_of
from app.multigrid.hierarchy import LARGEST_DIRECT
from app.multigrid.linear_solver import DirectSolver, LinearSolver


def solve(
    hierarchy,
    shapes,
    loading,
    controls,
    history,
    nested=False,
    beta=0.003,
    prolongation="copy",
    target_solver=None,
    lowest=None,
):
    """Solve the contact problem on the target grid of a hierarchy.

    Collective. Replicated grids are solved by rank 0, which tells the others.

    Parameters
    ----------
    hierarchy : Hierarchy
    shapes : list of ndarray
        Undeformed distance at zero approach on each level (see `Hierarchy.shapes`) [mm].
    loading : PrescribedApproach or PrescribedLoad
    controls : Controls
    history : History
    nested : bool
        Start on the coarsest grid, else from C = {h <= 0} on the target grid.
    beta : float
        Eq. (4.1).
    prolongation : {"copy", "lift"}
        The paper's, or `_lift`.
    target_solver : LinearSolver, optional
        Solver of the target grid, if there is one already.
    lowest : ndarray, optional
        See `Hierarchy.lowest`; without it windows are chosen from the contact of coarser grids alone.

    Returns
    -------
    ContactGrid, Outcome
        State of the target grid.
    """
    last = len(hierarchy.levels) - 1
    # Grids so coarse that no cell is admissible say nothing.
    blind = [
        number for number in range(last) if not _any_admissible(hierarchy.levels[number], shapes[number])
    ]
    first = blind[-1] + 1 if blind else 0
    route = range(first, last + 1) if nested else _direct_route(hierarchy, loading, first)
    below = outcome = outlook = None
    difference = float("nan")
    for number in route:
        level = hierarchy.levels[number]
        here = level.comm is not None or hierarchy.comm.rank == 0 or number == last
        frame = Frame(hierarchy, number, shapes[number], below if nested else None, outlook)
        state = frame.state
        if below is None:
            loading.start(state)
        elif nested:
            _prolong(frame, beta, prolongation)
        else:
            state.approach = below.approach
            state.start_from_interpenetration()
        if here:
            # First order: half the difference of the two grids below, which is about the error of the finer one.
            expected = 0.5 * difference if difference > 0 else 0.0
            arguments = loading, controls, history, number == last, expected
            given = target_solver if number == last else None
            direct = below is None and number != last and _direct(level)
            outcome = _iterate(hierarchy, number, state, arguments, given, direct)
        if level.comm is None and hierarchy.comm.size > 1 and number < last:
            _tell(hierarchy.comm, state)
        outlook = frame.outlook(lowest)
        if nested and below is not None:
            difference = _difference(frame.transfer, frame.below.p, state)
        if below is not None:
            below.destroy()
        frame.close()
        below = state
        if number == last and frame.windowed:
            state, complete = frame.everything(outcome)
            if not complete:
                outcome = _iterate(hierarchy, number, state, arguments).after(outcome)
    return state, replace(
        outcome, discretisation_error=difference if controls.telling(difference) else float("nan")
    )


def _iterate(hierarchy, number, state, arguments, given=None, direct=False):
    """Solve on one grid, with a solver of its own if none is given. Collective over the ranks of `state`."""
    operator = state.operator
    if direct:
        solver = DirectSolver(operator, number)
    else:
        solver = given or LinearSolver(hierarchy, number, operator.petsc_comm, operator=operator)
    outcome = iterate(state, solver, *arguments)
    if outcome.reason == WANDERS:
        outcome = _search_approach(state, solver, *arguments).after(outcome)
    if solver is not given:
        solver.destroy()
    if outcome.reason == SINGLE_EXHAUSTED:
        operator.use_double()
        state.current = state.exact  # or u is a sum of single precision products
        outcome = _iterate(hierarchy, number, state, arguments).after(outcome)
    return outcome


_NEAR = 1e-3  # of the load: from here on the load itself can be prescribed
_ROUGHLY = 1e-4  # residual that is enough to see the load of an approach
_SEARCHES = 20


def _search_approach(state, solver, loading, controls, *arguments):
    """Find the approach of a given load by solving for approaches; the load grows with them.

    Slow but safe, for crowds of tiny contacts: under a given load their area may grow and shrink without end.
    Collective over the ranks of `state`.
    """
    rtol, near = _ROUGHLY, _NEAR
    lowest, highest, before, outcome = -np.inf, np.inf, None, None
    bisected = False
    following = state.approach
    for _ in range(_SEARCHES):
        state.approach = following
        roughly = replace(controls, rtol=max(controls.rtol, rtol))
        found = iterate(state, solver, PrescribedApproach(following), roughly, *arguments)
        outcome = found.after(outcome) if outcome else found
        if not found.converged:
            return outcome
        here = following, state.load
        lacks = loading.load - here[1]
        slow = before and not bisected and abs(lacks) > 0.3 * abs(loading.load - before[1])
        if slow and rtol > controls.rtol:
            rtol *= 0.1  # so roughly, loads and with them the bounds may be wrong
            lowest, highest = -np.inf, np.inf
        lowest, highest = (here[0], highest) if lacks > 0 else (lowest, here[0])
        slope = (here[1] - before[1]) / (here[0] - before[0]) if before else 0.0
        if not slope > 0:
            # As if the load were proportional to the mean displacement in contact.
            total, cells = state.sum([np.sum(state.u, where=state.contact), np.count_nonzero(state.contact)])
            slope = here[1] * cells / total if total > 0 else loading.load / state.gap_norm()
        following = here[0] + lacks / slope
        bisected = not lowest < following < highest and np.isfinite(highest - lowest)
        if bisected:
            following = 0.5 * (lowest + highest)
        before = here
        if abs(lacks) <= near * loading.load:
            outcome = iterate(state, solver, loading, controls, *arguments).after(outcome)
            if outcome.reason != WANDERS:
                return outcome
            rtol, near = 0.01 * rtol, 0.01 * near
        if following in (lowest, here[0], highest):
            return replace(outcome, converged=False, reason="no approach is nearer to the one of the load")
    return replace(outcome, converged=False, reason=f"{_SEARCHES} approaches did not meet the load")


def _difference(transfer, coarse, state):
    """Return the rms difference of the pressures on two grids over that of the larger; NaN if none. Collective."""
    fine = transfer.restrict_defect(state.p)
    change = fine - coarse
    squares = sum_over(transfer.coarse.comm, [np.vdot(p, p) for p in (change, fine, coarse)])
    return float(np.sqrt(squares[0] / max(squares[1:]))) if squares[0] > 0 else float("nan")


def _any_admissible(level, shape):
    """Whether contact is possible in any cell of a level. Collective over its ranks."""
    return sum_over(level.comm, [not np.isnan(shape).all()])[0] > 0


def _direct_route(hierarchy, loading, first):
    """Levels visited without nested iteration: the target; to find an approach, a grid small enough first."""
    last = len(hierarchy.levels) - 1
    if isinstance(loading, PrescribedApproach):
        return [last]
    small = [number for number in range(first, last) if _direct(hierarchy.levels[number])]
    return [*small[-1:], last]


def _direct(operator):
    """Whether the grid is small enough, and here as a whole, to be solved directly."""
    return operator.comm is None and operator.grid.n <= LARGEST_DIRECT


def _tell(comm, state):
    """Give all ranks what rank 0 has found on a replicated grid."""
    with state.pressure as p:
        comm.Bcast(p)
    comm.Bcast(state.u)
    comm.Bcast(state.contact)
    state.approach = comm.bcast(state.approach)


def _prolong(frame, beta, prolongation):
    """Steps 2 and (3.a): contact set, pressure and displacement from the coarser grid."""
    transfer, below, state = frame.transfer, frame.below, frame.state
    state.approach = below.approach
    state.current = False
    transfer.interpolate(below.u, state.u)
    if prolongation == "copy" or not _lift(transfer, below, state):
        _copy(transfer, below, state, beta)


def _copy(transfer, below, state, beta):
    """Take p by copy, u bilinear, C = {h + u <= beta max(u)}, p = 0 outside."""
    highest = -float(state.minimum(-state.u.max(initial=-np.inf)))
    with state.right as scratch:
        overlap = np.subtract(state.shape, state.approach, out=scratch.reshape(state.u.shape))
        overlap += state.u
        np.less_equal(overlap, beta * highest, out=state.contact)
    state.contact &= state.admissible
    with state.pressure as values:
        p = values.reshape(state.u.shape)
        transfer.copy(below.p, p)
        np.copyto(p, 0.0, where=~state.contact)


def _lift(transfer, below, state):
    """Take p as the pressure that would displace the cells so in a periodic world.

    With the circulant matrix B^-1 for A, a displacement T that is known everywhere gives p = B T at the cost of an FFT:
    on C it is -h, elsewhere the interpolated one of the coarse grid, both plus what the coarse grid says
    is the difference of periodic and true displacement. Start set: the coarse one and {h + u <= 0}, where p > 0.

    Returns
    -------
    bool
        False if the load came out so different that the coarse grid cannot be trusted.
    """
    periodic = np.empty_like(below.u)
    circulant_of(below.operator).apply_inverse(below.p, periodic)
    contact = np.empty(state.contact.shape, bool)
    transfer.copy(below.contact, contact)
    with state.pressure as values, state.right as scratch:
        overlap = np.subtract(state.shape, state.approach, out=scratch.reshape(state.u.shape))
        overlap += state.u
        contact |= overlap <= 0
        contact &= state.admissible
        target = values.reshape(state.u.shape)
        transfer.interpolate(periodic, target)
        np.subtract(target, overlap, out=target, where=contact)
        circulant_of(state.operator).apply(target, target)
        contact &= target > 0
        np.copyto(target, 0.0, where=~contact)
    state.contact[...] = contact
    return 0.05 * below.load < state.load < 20 * below.load
