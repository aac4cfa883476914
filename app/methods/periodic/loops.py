"""Compiled loops of the primal active set.

Arrays have the shape (rows, nx), with the rows of this rank. w is the displacement minus the approach, b is minus the
shape, and the gap is ``e = w - b``.
"""

import numpy as np

from app.parallel.reductions import njit_reassoc


@njit_reassoc
def _close_row(w, b, captured, z, share, change):
    for i in range(w.size):
        step = b[i] - w[i] if captured[i] else change[i] + share * z[i]
        change[i] = step
        w[i] = b[i] if captured[i] else w[i] + change[i]


@njit_reassoc
def close(w, b, captured, z, share, change):
    """Add a step to the displacement w; close gaps of captured cells.

    The step is `change` plus `share` times z. In captured cells w becomes b instead, which is minus the shape. `change`
    receives the whole change of w.
    """
    for j in range(w.shape[0]):
        _close_row(w[j], b[j], captured[j], z[j], share, change[j])


@njit_reassoc
def _touch_row(w, b, admissible, contact, change):
    for i in range(w.size):
        touches = contact[i] | (admissible[i] & (w[i] <= b[i]))
        step = b[i] - w[i] if touches else 0.0
        contact[i] = touches
        change[i] = step
        w[i] = b[i] if touches else w[i]


@njit_reassoc
def touch(w, b, admissible, contact, change):
    """Add overlapping cells to the contact set; close the gap in contact.

    To close it, the displacement w becomes b, which is minus the shape. `change` receives the change of w.
    """
    for j in range(w.shape[0]):
        _touch_row(w[j], b[j], admissible[j], contact[j], change[j])


@njit_reassoc
def _guess_row(p, w, b, admissible, scale, force, lowest):
    for i in range(p.size):
        force[i] = np.float32(-p[i] * scale)
        lowest[i] = np.float32(b[i] - w[i]) if admissible[i] else np.float32(-np.inf)


@njit_reassoc
def guess_sources(p, w, b, admissible, scale, force, lowest):
    """Compute force and lower bound of an obstacle problem.

    The unknown x of the problem is the change of the displacement w. `force` receives the right-hand side -scale p.
    `lowest` receives the lower bound of x, which is minus the gap w - b, or -inf where contact is impossible.
    """
    for j in range(p.shape[0]):
        _guess_row(p[j], w[j], b[j], admissible[j], scale, force[j], lowest[j])


@njit_reassoc
def _apply_guess_row(x, lowest, w, b, contact):
    for i in range(x.size):
        inside = x[i] <= lowest[i]
        contact[i] = inside
        w[i] = b[i] if inside else w[i] + x[i]


@njit_reassoc
def apply_guess(x, lowest, w, b, contact):
    """Add the solution x of the obstacle problem to the displacement w.

    `contact` receives the cells where x is not above its lower bound `lowest`, which is minus the gap. There w is set
    to b, so that the gap ``w - b`` is exactly zero.
    """
    for j in range(x.shape[0]):
        _apply_guess_row(x[j], lowest[j], w[j], b[j], contact[j])
