"""What is prescribed: the approach, or the load, for which the approach is found along the way.

The load ``F(delta) = dx dy sum(p)`` has the slope ``dx dy sum(q)``, ``A q = 1`` on C. With some approximation of q, a
pressure whose defect on C is r carries, once solved, ``F = dx dy (sum(p) - q.r)`` up to second order. So every active
set iteration yields a Newton step for the approach without a product,

    delta += (F_wanted - F) / (dx dy sum(q)),    p += q times the same, on C.

q is solved for on the coarsest grid, improved once on every further grid of a nested iteration but the target, and
carried along otherwise: its error only slows the convergence of the load, and it is improved again if it does.
"""

from __future__ import annotations

import numpy as np


class PrescribedApproach:
    """The approach is given [mm]."""

    prescribes_load = False

    def __init__(self, approach):
        self.approach = float(approach)

    def start(self, state):
        """Choose approach, contact set and pressure on the first grid. Not collective."""
        state.approach = self.approach
        state.start_from_interpenetration()

    def begin(self, state, solver, first, target):
        """Prepare the iteration on a grid. Not collective."""

    def measure(self, state):
        """Return the relative error of the load: none is prescribed."""
        return 0.0

    def adjust(self, state, solver, change, solved):
        """Keep the approach."""

    def rescale(self, state):
        """Keep the pressure."""


class PrescribedLoad:
    """The total force is given.

    Parameters
    ----------
    load : float
        F, positive [N].
    """

    prescribes_load = True
    # A Newton step is expected to leave less than this share of the load error; otherwise q is too bad.
    _expected = 0.25
    _settled = 0.02  # share of changed cells

    def __init__(self, load):
        self.load = float(load)
        self._previous = np.inf

    def start(self, state):
        """Start with contact everywhere: most loads will tear it open again. Collective."""
        state.approach = state.mean_shape()
        state.contact[...] = state.admissible
        state.pressure.set(0)
        state.u[...] = 0

    def begin(self, state, solver, first, target):
        """Improve q on a new grid, and find the approach on the first one. Collective."""
        self._previous = np.inf
        if solver.tracks:
            state.touch()
            self.rescale(state)
            return
        if state.unit is None:
            state.make_unit()
        if first:
            state.touch()
            solver.contact_changed()
            self._improve(state, solver)
            state.right_hand_side_to(state.right)
            solver.solve(state.right, state.pressure, 0.01 * state.gap_norm())
            state.current = False
            self._step(state, solved=True)
        elif not target or not self._sums(state, True)[1] > 0:
            state.touch()
            solver.contact_changed()
            self._improve(state, solver)

    def measure(self, state):
        """Return the relative error of the load. Collective."""
        return abs(state.load - self.load) / self.load

    def adjust(self, state, solver, change, solved):
        """Take a Newton step for the approach.

        Collective.

        Parameters
        ----------
        change : Change
            What the last update of the contact set did.
        solved : bool
            The defect is small enough: what is left of it is not to be waited for.
        """
        touched = state.touch()
        if solver.tracks:
            if touched or self.measure(state) > 1e-12:
                self.rescale(state)
            return
        error = abs(self._sums(state, solved)[2])
        if (
            touched
            or solver.exact
            or error > self._expected * self._previous
            or not self._sums(state, True)[1] > 0
        ):
            solver.contact_changed()
            self._improve(state, solver)
            error = abs(self._sums(state, solved)[2])
        self._previous = error
        self._step(state, solved)

    def rescale(self, state):
        """Give the pressure the load; spread it evenly over C if there is none. Collective."""
        total = state.pressure.sum()
        wanted = self.load / state.grid.cell_area
        if total > 0:
            state.pressure.scale(wanted / total)
        else:
            state.touch()
            cells = state.sum([state.contact.sum()])[0]
            state.pressure.setArray(state.contact.reshape(-1) * (wanted / cells))
        state.current = False

    def _improve(self, state, solver):
        """Let the linear solver work on A q = 1 on C."""
        inside = state.contact.reshape(-1)
        with state.unit as q, state.right as right:
            q *= inside
            state.operator.product.apply(
                q.reshape(state.u.shape), right.reshape(state.u.shape), state.contact
            )
            np.subtract(inside, right, out=right)
        solver.solve(state.right, solver.work, 0.02 * np.sqrt(state.sum([inside.sum()])[0]))
        state.unit.axpy(1.0, solver.work)

    def _sums(self, state, solved):
        """Return the approximations of F and dF/d delta per cell area, and what F lacks."""
        contact = state.contact
        p = state.pressure.getArray(readonly=True).reshape(contact.shape)
        q = state.unit.getArray(readonly=True).reshape(contact.shape)[contact]
        defect = 0.0 if solved else q @ (state.shape[contact] - state.approach + state.u[contact])
        force, slope, expected = state.sum([p.sum(), q.sum(), p.sum() - defect])
        return force, slope, self.load / state.grid.cell_area - expected

    def _step(self, state, solved):
        _, slope, lacking = self._sums(state, solved)
        if not slope > 0:
            return  # q is useless so far; the next improvement mends it
        step = lacking / slope
        state.approach += step
        with state.pressure as p:
            p += step * (state.unit.getArray(readonly=True) * state.contact.reshape(-1))
        state.current = False
