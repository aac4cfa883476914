"""What is prescribed: the approach, or the load, for which the approach is found along the way.

Contact under a given load is the same problem with the constraint ``dx dy sum(p) = F``; the approach is its Lagrange
multiplier. Every active set iteration restores the load by a constant pressure on C, and takes the mean defect on C
into the approach. The first happens just before, the second just after the product that the update of the contact
set needs anyway, so neither costs one.

A constant is not q, the solution of ``A q = 1`` on C, which would be exact. It takes ``s = |C|^2 / (1.A1)`` for the
slope ``S = 1.q`` of the load, and ``s <= S`` (Cauchy and Schwarz): 0.92 S on a circle, but little where a large contact
area has many small ones around it. The approach would go S/s times too far, and a solver that then solves exactly
leave 1 - S/s of what the load lacked before. So two successive iterations tell s/S (Aitken's relaxation).
"""

from __future__ import annotations

import numpy as np

from app.contact import kernels


class PrescribedApproach:
    """The approach is given [mm]."""

    prescribes_load = False

    def __init__(self, approach):
        self.approach = float(approach)

    def start(self, state):
        """Choose approach, contact set and pressure on the first grid. Not collective."""
        state.approach = self.approach
        state.start_from_interpenetration()

    def begin(self, state):
        """Prepare the iteration on a grid. Not collective."""

    def balance(self, state):
        """Keep the pressure that the linear solver found."""

    def rescale(self, state):
        """Keep the pressure that dropping cells has left."""

    def settle(self, state):
        """Keep the approach."""


class PrescribedLoad:
    """The total force is given.

    Parameters
    ----------
    load : float
        F, positive [N].
    """

    prescribes_load = True
    _most = 5.0  # times that s/S may fall at once: what the load lacks has other reasons, too

    def __init__(self, load):
        self.load = float(load)
        self._forget()

    def _forget(self):
        self._relaxation, self._lacked = 1.0, 0.0

    def start(self, state):
        """Start with contact everywhere: most loads will tear it open again. Not collective."""
        state.approach = state.mean_shape()
        state.contact[...] = state.admissible
        state.pressure.set(0)
        state.u[...] = 0

    def begin(self, state):
        """Give the first pressure on a grid the load. Collective."""
        self._forget()
        state.touch()
        self.rescale(state)

    def balance(self, state):
        """Give the pressure the load by a constant on C; it may be negative after that. Collective."""
        total, cells = state.sum([state.p.sum(), np.count_nonzero(state.contact)])
        lacks = self.load / state.grid.cell_area - total
        if self._lacked:
            ratio = min(1.0 - lacks / self._lacked, self._most)
            self._relaxation = min(self._relaxation / ratio, 1.0) if ratio > 0 else 1.0
        self._lacked = lacks
        with state.pressure as values:
            p = values.reshape(state.u.shape)
            np.add(p, lacks / cells, out=p, where=state.contact)
        state.current = False

    def rescale(self, state):
        """Give the pressure the load by a factor; spread it evenly over C if there is none. Collective."""
        total = state.pressure.sum()
        wanted = self.load / state.grid.cell_area
        if total <= 0:
            state.touch()
            cells = state.sum([state.contact.sum()])[0]
            state.pressure.setArray(state.contact.reshape(-1) * (wanted / cells))
        else:  # which may be NaN, for the residual to tell
            state.pressure.scale(wanted / total)
        state.current = False

    def settle(self, state):
        """Take the mean defect on C into the approach. Collective."""
        total, cells = state.sum(kernels.total_defect(state.shape, state.u, state.approach, state.contact))
        if cells:
            state.approach += self._relaxation * total / cells
