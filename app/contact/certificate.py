"""How good a pressure is, proved from the pressure itself.

With ``f(p) = p.Ap / 2 + h.p``, the contact problem is ``min f(p), p >= 0``, its dual ``max -q.Aq / 2, h + A q >= 0``.
Any feasible pair bounds the error in the energy norm,

    ||p - p*||_A^2 / 2 <= f(p) - f(p*) <= f(p) + q.Aq / 2.

A dual feasible q costs no product: A p > 0 everywhere, so ``q = (1 + t) p`` with ``t = max(-e / u)`` lifts every
penetration. The gap of the pair is then ``p.e + (t + t^2 / 2) p.u``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_ROWS_AT_ONCE = 64


@dataclass(frozen=True)
class Certificate:
    """Optimality of a pressure; the same on all ranks."""

    duality_gap: float  # [mm N/mm2 per cell area] * cell area = [N mm]
    error_bound: float  # ||p - p*||_A / ||p||_A at most; 0 if there is no pressure
    largest_penetration: float  # max(-e) over the admissible cells, at least 0 [mm]
    smallest_pressure: float  # [N/mm2]
    complementarity: float  # max |p e| / (max p * max |h|)

    def describe(self):
        """Attributes for the result file."""
        return vars(self).copy()


def certify(state):
    """Certify the pressure of a `ContactGrid` with one product in double precision.

    Collective. Recomputes ``state.u`` from the pressure.

    Returns
    -------
    Certificate
    """
    state.operator.exact_displacement(state.p, state.u)
    largest = np.full(7, -np.inf)
    sums = np.zeros(2)
    for first in range(0, len(state.u), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        p, u, admissible = state.p[rows], state.u[rows], state.admissible[rows]
        h = np.where(admissible, state.shape[rows] - state.approach, 0.0)
        e = np.where(admissible, h + u, 0.0)
        pressed = u > 0
        lift = np.divide(-e, u, out=np.zeros_like(e), where=pressed)
        here = (
            lift.max(),
            -e.min(),
            -p.min(),
            np.abs(p * e).max(),
            p.max(),
            np.abs(h).max(),
            (e[~pressed] < 0).any(),
        )
        largest = np.maximum(largest, here)
        sums += np.vdot(p, u), np.vdot(p, e)
    largest = np.maximum(-state.minimum(-largest), [0, 0, -np.inf, 0, 0, 0, 0])
    t, penetration, minus_smallest, product, highest, deepest, unlifted = (float(value) for value in largest)
    energy, defect = state.sum(sums) * state.grid.cell_area
    gap = np.inf if unlifted else max(float(defect + (t + t * t / 2) * energy), 0.0)
    return Certificate(
        duality_gap=gap,
        error_bound=float(np.sqrt(2 * gap / energy)) if energy > 0 else gap,
        largest_penetration=max(penetration, 0.0) + 0.0,
        smallest_pressure=0.0 - minus_smallest,
        complementarity=product / (highest * deepest) if highest * deepest > 0 else 0.0,
    )
