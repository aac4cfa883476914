"""Active set iteration around a KSP (Sec. 3: NORM; Sec. 4.1: MG + active set).

What the linear solver does to the system of each contact set - many CG iterations, a few, one multigrid
cycle - is its options' business. The pressure carries over from one set to the next.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Controls:
    """How long and how to iterate; see the options -lcp_*."""

    rtol: float = 1e-6  # ||r|| / ||h||, eq. (5.1), and a hundred times that against ||h|| on C
    max_it: int = 100
    coarse_rtol: float = 0.0  # 0: iterate on coarser grids until the contact set is unchanged
    merge: float = 0.0  # step of the correction that shares a product with the dropping of cells
    foresight: float = 0.0  # share of the change of u to come that is believed when cells are added
    cheap: bool = False  # stop on every grid when the discretisation error dominates

    # In cheap mode: residual over ||h|| on C, per expected relative error of the pressure; and at most. What cells just
    # added lack weighs more than the residual says, hence so little.
    _cheap_share = 0.005
    _cheap_most = 5e-4
    _telling = 0.02  # residual of coarser grids, per difference of pressures, that does not spoil it

    _in_contact = 100.0  # binds where contact is small in a large patch, or some cells are very far apart
    _digits = 1e-14  # of ||h||: what rounding of displacements leaves, however small the contact

    def acceptable(self, state, inside=None):
        """Norm of the residual that solves the problem [mm]; `inside`: the gap on C, if known. Collective if not."""
        whole = state.gap_norm()
        inside = state.gap_in_contact() if inside is None else inside
        # Rounding limits the second criterion only; the first is the user's word.
        least = max(self._digits * whole, inside.rounding)
        in_contact = max(self.rtol * self._in_contact * inside.norm, least) if inside.norm > 0 else np.inf
        return min(self.rtol * whole, in_contact)

    def loose(self, target, tracks, discretisation_error):
        """Residual over ||h|| on C that is enough on this grid; 0 if only (5.1) or an unchanged set will do."""
        coarse = self.coarse_rtol if tracks else 0.0
        if self.cheap and (target or coarse):
            enough = min(self._cheap_share * discretisation_error, self._cheap_most)
            return enough if target else min(coarse, enough or self._cheap_most)
        return 0.0 if target else coarse

    def telling(self, difference):
        """Whether pressures on two grids that differ so much do so for their discretisation errors. Not collective."""
        return self.cheap or self.coarse_rtol <= self._telling * difference


class Listener:
    """Hears of the iteration while it runs; called on the ranks that take part in a grid."""

    def start(self, state, level):
        """Hear of a grid, with the contact set it starts from in ``state.contact``; it may be empty."""

    def iteration(self, entry, state):
        """Hear of an active set iteration: its entry in the history, and the state after it."""

    def end(self):
        """Hear that all is over."""


@dataclass
class History:
    """One entry per active set iteration on any grid, and who wants to hear of it.

    Complete on rank 0; the others miss the replicated grids that it solved alone.
    """

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


# Reasons to go on in another way
SINGLE_EXHAUSTED = "single precision is exhausted"
WANDERS = "the approach to the given load wanders"
_PROVISIONAL_MARGIN = 0.9  # of the residual, for what the last word may find


@dataclass(frozen=True)
class Outcome:
    """How the iteration on one grid ended; the same on all ranks that took part."""

    converged: bool
    reason: str
    iterations: int
    inner_iterations: int
    residual: float  # ||r|| / ||h||, eq. (5.1)
    discretisation_error: float = float("nan")  # of the pressure (rms), relative, estimated from two grids

    def after(self, first):
        """Return this outcome with the iterations of `first`, of which it is the continuation, added."""
        return replace(
            self,
            iterations=first.iterations + self.iterations,
            inner_iterations=first.inner_iterations + self.inner_iterations,
        )


def iterate(state, solver, loading, controls, history, target=True, discretisation_error=0.0):
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
    target : bool
        Whether this is the target grid. On coarser ones an unchanged contact set is enough.
    discretisation_error : float
        Expected on this grid, relative; for ``controls.cheap``.

    Returns
    -------
    Outcome
    """
    started = time.perf_counter()
    inner = 0
    residual = 0.0
    work = solver.work_units
    policy = _Policy(controls)
    if solver.tracks:
        solver.relax()
    progress = _Progress()
    resume = False

    def end(converged, reason, iterations):
        return Outcome(converged, reason, iterations, inner, residual)

    loading.begin(state)
    for listener in history.listeners:
        listener.start(state, solver.level)
    if not state.in_contact():
        # A coarser grid may have missed it; without pressure the gap decides.
        state.start_from_interpenetration()
        if not state.in_contact():
            return end(True, "the bodies do not touch", 0)
    for iteration in range(1, controls.max_it + 1):
        inside = state.gap_in_contact()
        allowed = controls.acceptable(state, inside)
        if state.operator.provisional and target:
            allowed *= _PROVISIONAL_MARGIN
        loose = controls.loose(target, solver.tracks, discretisation_error)
        if loose:
            allowed = max(allowed, loose * min(state.gap_norm(), inside.norm))
        solver.contact_changed()
        inner_now, failure, norm = _advance(state, solver, loading, allowed, resume)
        inner += inner_now
        change, enough = policy.update(state, solver, loading, norm, allowed, loose, target)
        residual = _relative(change, state)
        done = change.changed == 0 and (not target or change.residual <= controls.acceptable(state))
        # Only a double precision product can accept an answer: single precision proposes, and sums of steps drift.
        checked = target and (enough or (done and not state.exact))
        if checked:
            if not state.exact:
                loading.rescale(state)
                state.displace_exactly()
            loading.settle(state)
            again = state.admit()
            residual = _relative(again, state)
            done = again.added == 0 and again.residual <= controls.acceptable(state)
            change = again.after(change)
            enough = enough and policy.enough(again.residual, again.added, again.cells, allowed)
        done |= enough
        resume = change.changed == 0 and state.current and not checked  # the same system, further on
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
            load=state.load,
            approach=state.approach,
            seconds=time.perf_counter() - started,
        )
        if failure:
            return end(False, f"the linear solver failed: {failure}", iteration)
        if not residual < float("inf"):
            return end(False, "the residual is not a finite number", iteration)
        if done:
            reason = "contact area unchanged and residual small enough"
            return end(True, "discretisation error reached" if enough and target else reason, iteration)
        progress.hear_of(change)
        if target and progress.exhausted(state):
            return end(False, SINGLE_EXHAUSTED, iteration)
        if target and loading.prescribes_load and progress.wanders():
            return end(False, WANDERS, iteration)
        if progress.stuck():
            policy.calm(solver)
    return end(False, f"{controls.max_it} active set iterations were not enough", controls.max_it)


def _relative(change, state):
    """||r|| / ||h||, eq. (5.1), at the approach of now. Not collective."""
    return change.residual / state.gap_norm()


def _advance(state, solver, loading, allowed, resume):
    """Steps 2 and 3: let the linear solver improve the pressure on C.

    Returns
    -------
    iterations : int
    failure : str
    norm : float
        Of the residual afterwards, if the solver tells [mm].
    """
    if not state.current:
        state.displace()
    if solver.tracks:
        state.right_hand_side_to(state.right)
        balance = loading.prescribes_load
        iterations, failure, norm, shift = solver.track(
            state.right, state.pressure, state.u, allowed, balance, resume
        )
        state.approach += shift
        if iterations:
            state.displaced_along()
        return iterations, failure, norm
    state.defect_to(state.right)
    iterations, failure = solver.solve(state.right, solver.work, allowed)
    state.pressure.axpy(1.0, solver.work)
    state.current = False
    loading.balance(state)
    return iterations, failure, float("inf")


class _Progress:
    """Tells when more of the same iterations are of no use."""

    _patience = 3  # iterations in single precision that do not halve the residual
    _noise = 1e-5  # of h on C: a larger residual is not for want of digits
    _stubborn = 4  # iterations that do not, before the contact set is changed with more care
    _longest = 8  # iterations under a given load that do not halve the residual

    def __init__(self):
        self._best, self._since, self._residual = float("inf"), 0, float("inf")

    def hear_of(self, change):
        """Take notice of an iteration. Not collective."""
        self._residual = change.residual
        self._since += 1
        if change.residual < 0.5 * self._best:
            self._best, self._since = change.residual, 0

    def stuck(self):
        """Whether it is time for smaller steps. Not collective."""
        return self._since > 0 and self._since % self._stubborn == 0

    def exhausted(self, state):
        """Whether the digits of single precision are used up. Collective."""
        if self._since < self._patience or state.operator.dtype != "float32":
            return False
        return self._residual <= self._noise * state.gap_in_contact().norm

    def wanders(self):
        """Whether the contact area grows and shrinks without end. Not collective."""
        return self._since >= self._longest


class _Policy:
    """Step 4, and what keeps it cheap and safe: the product that dropped cells cost also carries a correction."""

    _merges = 12  # on one grid; after that dropped cells get a product of their own
    _blow_up = 4.0
    _shortest = 0.1
    _little = 0.01  # of the load may be dropped, of the cells changed, where loose accuracy is enough

    def __init__(self, controls):
        self.cheap = controls.cheap
        self.step, self.foresight = controls.merge, controls.foresight
        self.merges = 0
        self.seen = set()

    def update(self, state, solver, loading, norm, allowed, loose, target):
        """Update the contact set after the linear solver left a residual of `norm`.

        Collective.

        Returns
        -------
        change : Change
        enough : bool
            Nothing more to do where `loose` accuracy is enough; u may not be up to date.
        """
        dropped, tension = state.drop()
        if loose and not (target or self.cheap) and norm <= allowed and tension <= self._little:
            return state.admit(), True
        merged = False
        if dropped and solver.tracks:
            solver.contact_changed()
            merged = self.step > 0 and norm > allowed and self.merges < self._merges
            if merged:
                self._correct(state, solver)
        if not state.current:
            loading.rescale(state)
            state.displace()
        loading.settle(state)
        change = self._admit(state, solver, norm > allowed)
        if merged and change.residual > self._blow_up * norm and change.residual > allowed:
            self.step = max(0.5 * self.step, self._shortest)
        if change.changed and solver.tracks:
            fingerprint = state.fingerprint()
            if dropped and fingerprint in self.seen:
                self._care(solver)
            self.seen.add(fingerprint)
        return change, bool(loose) and self.enough(change.residual, change.changed, change.cells, allowed)

    def enough(self, residual, changed, cells, allowed):
        """Whether loose accuracy is reached. Not collective."""
        return residual <= allowed and changed <= self._little * cells

    def calm(self, solver):
        """Take smaller steps from now on: the residual does not fall. Not collective."""
        self._care(solver)
        self.step = 0.0

    def _care(self, solver):
        if solver.tracks:
            solver.tighten()
        self.foresight = 0.0

    def _admit(self, state, solver, more_to_come):
        """(4b), while the pressure is far from final by what u will be when the residual is gone."""
        if not (self.foresight > 0 and solver.tracks and more_to_come):
            return state.admit()
        state.defect_to(state.right)
        return state.admit(self.foresight, solver.foresee(state.right))

    def _correct(self, state, solver):
        """p += step M r on what is left of C; r still knows nothing of what was dropped."""
        state.defect_to(state.right)
        solver.correct(state.right, state.pressure, self.step)
        self.merges += 1
