"""Active set iteration around a KSP (Sec. 3: NORM; Sec. 4.1: MG + active set).

What the linear solver does to the system of each contact set - many CG iterations, a few, one multigrid
cycle - is its options' business. The pressure carries over from one set to the next.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Controls:
    """How long to iterate: options -lcp_rtol, -lcp_max_it."""

    rtol: float = 1e-6
    max_it: int = 100

    def load_tolerance(self, target):
        """Relative error of a prescribed load that is small enough."""
        return 0.1 * self.rtol if target else max(1e-3, self.rtol)


class Listener:
    """Hears of the iteration while it runs; called on the ranks that take part in a grid."""

    def start(self, state, level):
        """Hear of a grid whose first contact set is in ``state.contact``."""

    def iteration(self, entry, state):
        """Hear of an active set iteration: its entry in the history, and the state after it."""

    def end(self):
        """Hear that all is over."""


@dataclass
class History:
    """One entry per active set iteration on any grid, and who wants to hear of it."""

    listeners: list = field(default_factory=list)
    entries: list = field(default_factory=list)

    def add(self, state, **entry):
        """Record an iteration. Not collective."""
        self.entries.append(entry)
        for listener in self.listeners:
            listener.iteration(entry, state)

    def columns(self):
        """Return the entries as name -> list. Not collective."""
        return (
            {name: [entry[name] for entry in self.entries] for name in self.entries[0]}
            if self.entries
            else {}
        )


@dataclass(frozen=True)
class Outcome:
    """How the iteration on one grid ended; the same on all ranks that took part."""

    converged: bool
    reason: str
    iterations: int
    inner_iterations: int
    residual: float  # ||r|| / ||h||, eq. (5.1)


def iterate(state, solver, loading, controls, history, first=True, target=True):
    """Solve the problem of one grid from the contact set and pressure in `state`.

    Collective over the ranks of `state`.

    Parameters
    ----------
    state : ContactGrid
    solver : LinearSolver or DirectSolver
        On the same operator.
    loading : PrescribedApproach or PrescribedLoad
    controls : Controls
    history : History
    first, target : bool
        Whether this is the first and the target grid. On coarser grids than the target an unchanged contact
        set is enough.

    Returns
    -------
    Outcome
    """
    started = time.perf_counter()
    inner = 0
    residual = 0.0
    work = solver.work_units

    def end(converged, reason, iterations):
        return Outcome(converged, reason, iterations, inner, residual)

    loading.begin(state, solver, first, target)
    for listener in history.listeners:
        listener.start(state, solver.level)
    if state.sum([state.contact.sum()])[0] == 0:
        state.pressure.set(0)
        state.u[...] = 0
        return end(True, "the bodies do not touch", 0)
    for iteration in range(1, controls.max_it + 1):
        gap_norm = state.gap_norm() or 1.0
        state.set_right_hand_side()
        solver.contact_changed()
        inner_now, failure = solver.solve(state.right, state.correction, controls.rtol * gap_norm)
        state.pressure.axpy(1.0, state.correction)
        inner += inner_now
        change = state.update()
        residual = change.residual / gap_norm
        load_error = loading.measure(state)
        done = change.changed == 0 and load_error <= controls.load_tolerance(target)
        done &= not target or residual <= controls.rtol
        load, approach = state.load, state.approach
        if not done and not failure:
            loading.adjust(state, solver, change, solved=residual <= controls.rtol)
        work, work_before = solver.work_units, work
        history.add(
            state,
            level=solver.level,
            iteration=iteration,
            contact_cells=change.cells,
            added_cells=change.added,
            dropped_cells=change.dropped,
            changed_cells=change.changed,
            residual=residual,
            inner_iterations=inner_now,
            work_units=work - work_before,
            load=load,
            approach=approach,
            seconds=time.perf_counter() - started,
        )
        if failure:
            return end(False, f"the linear solver failed: {failure}", iteration)
        if not residual < float("inf"):
            return end(False, "the residual is not a finite number", iteration)
        if done:
            return end(True, "contact area unchanged and residual small enough", iteration)
    return end(False, f"{controls.max_it} active set iterations were not enough", controls.max_it)
