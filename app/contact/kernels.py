"""One pass over the cells instead of ten: the loops of the active set update, compiled.

Arrays are (rows, nx) of a rank; sums are per row first, so that they lose nothing on large grids.
"""

from __future__ import annotations

import numba
import numpy as np

from app.halfspace.reductions import any_nonzero, any_order


@any_order
def _defect_row(shape, u, approach, contact, out):
    for i in range(shape.size):
        r = approach - shape[i] - u[i]
        out[i] = r if contact[i] else 0.0


@any_order
def defect(shape, u, approach, contact, out):
    """out = -(h + u) on C, 0 elsewhere."""
    for j in range(shape.shape[0]):
        _defect_row(shape[j], u[j], approach, contact[j], out[j])


@any_order
def _total_defect_row(shape, u, approach, contact):
    total, cells = 0.0, 0
    for i in range(shape.size):
        e = shape[i] - approach + u[i]
        total += e if contact[i] else 0.0
        cells += contact[i]
    return total, cells


@any_order
def total_defect(shape, u, approach, contact):
    """Sum of h + u over C, and the number of cells there."""
    total, cells = 0.0, 0
    for j in range(shape.shape[0]):
        here = _total_defect_row(shape[j], u[j], approach, contact[j])
        total += here[0]
        cells += here[1]
    return total, cells


@any_order
def _right_hand_side_row(shape, approach, contact, out):
    for i in range(shape.size):
        r = approach - shape[i]
        out[i] = r if contact[i] else 0.0


@any_order
def right_hand_side(shape, approach, contact, out):
    """out = -h on C, 0 elsewhere."""
    for j in range(shape.shape[0]):
        _right_hand_side_row(shape[j], approach, contact[j], out[j])


@any_order
def _drop_row(p, contact, dropped):
    count, tension, kept = 0, 0.0, 0.0
    for i in range(p.size):
        out = contact[i] & (p[i] < 0)
        dropped[i] = out
        contact[i] &= not out
        count += out
        tension -= p[i] if out else 0.0
        p[i] = 0.0 if out else p[i]
        kept += p[i]
    return count, tension, kept


@numba.njit(cache=True)
def drop(p, contact, dropped):
    """(4a) Take cells with p < 0 out of C, set p = 0 there, mark them.

    Return their number and pressure, and the sum of the others.
    """
    count, tension, kept = 0, 0.0, 0.0
    for j in range(p.shape[0]):
        here = _drop_row(p[j], contact[j], dropped[j])
        count += here[0]
        tension += here[1]
        kept += here[2]
    return count, tension, kept


@numba.njit(cache=True)
def _overlap_row(shape, u, approach, overlap):
    for i in range(shape.size):
        overlap[i] = shape[i] - approach + u[i] <= 0


@numba.njit(cache=True)
def _foreseen_overlap_row(shape, u, approach, foresight, change, overlap):
    for i in range(shape.size):
        overlap[i] = shape[i] - approach + u[i] + foresight * change[i] <= 0


@any_order
def _admit_row(overlap, admissible, contact, dropped):
    cells, added, lost = 0, 0, 0
    for i in range(contact.size):
        new = (not contact[i]) & admissible[i] & overlap[i]
        contact[i] |= new
        cells += contact[i]
        added += new & (not dropped[i])
        lost += dropped[i] & (not contact[i])
    return cells, added, lost


@any_order
def _squares_row(shape, u, approach, contact):
    total = 0.0
    for i in range(shape.size):
        e = shape[i] - approach + u[i]
        total += e * e if contact[i] else 0.0
    return total


@numba.njit(cache=True)
def admit(shape, u, approach, admissible, contact, dropped, foresight, change):
    """(4b) Put cells outside C into it that overlap; or will, when u goes on by `foresight` times `change`, if given.

    Return how many cells are in C, came, left, changed, and the sum of squares of h + u over the new C.
    """
    cells, added, lost, total = 0, 0, 0, 0.0
    overlap = np.empty(shape.shape[1], np.bool_)
    for j in range(shape.shape[0]):
        if change is None:
            _overlap_row(shape[j], u[j], approach, overlap)
        else:
            _foreseen_overlap_row(shape[j], u[j], approach, foresight, change[j], overlap)
        here = _admit_row(overlap, admissible[j], contact[j], dropped[j])
        cells += here[0]
        added += here[1]
        lost += here[2]
        if here[0]:
            total += _squares_row(shape[j], u[j], approach, contact[j])
    return cells, added, lost, added + lost, total


@any_order
def _norm_row(shape, approach, contact):
    total = 0.0
    for i in range(shape.size):
        h = shape[i] - approach
        total += h * h if contact[i] else 0.0
    return total


@any_order
def norm_on(shape, approach, contact):
    """Sum of squares of h over C."""
    total = 0.0
    for j in range(shape.shape[0]):
        total += _norm_row(shape[j], approach, contact[j])
    return total


def crc(mask):
    """A fingerprint of a mask as a float that sums exactly over some thousand ranks."""
    import zlib

    return float(zlib.crc32(np.ascontiguousarray(mask).view(np.uint8)))


def load():
    """Load the compiled loops now, not in the first iteration. Not collective."""
    field, mask = np.zeros((0, 0)), np.zeros((0, 0), bool)
    defect(field, field, 0.0, mask, field)
    right_hand_side(field, 0.0, mask, field)
    total_defect(field, field, 0.0, mask)
    drop(field, mask, mask)
    for change in (None, field, field.astype(np.float32)):
        admit(field, field, 0.0, mask, mask, mask, 0.0, change)
    norm_on(field, 0.0, mask)
    any_nonzero(mask)
