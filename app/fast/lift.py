"""Lift: the pressure of the next finer grid from the displacement, by the FFT preconditioner (in place of copying p).

With the circulant matrix B^-1 for A, a displacement T that is known everywhere gives p = B T at the cost of an FFT:
on C it is -h, elsewhere the interpolated one of the coarse grid, both plus what the coarse grid says is the difference
of periodic and true displacement. First contact set: the coarse one and {h + u <= 0}, where p > 0.

Switch: ``-lcp_prolongation lift|copy``. Gain: see `app.fast`.
"""

from __future__ import annotations

import numpy as np

from app.fast.circulant import circulant_of

_TRUSTED = (
    20.0  # factor in the load; a grid so coarse that it is missed by more says nothing, and copying is safer
)


def lift(transfer, coarse, state):
    """Set C and p of `state`, whose u is interpolated already.

    Collective.

    Returns
    -------
    bool
        False if the load came out so different that the coarse grid cannot be trusted; u is as it was.
    """
    periodic = np.empty_like(coarse.u)
    circulant_of(coarse.operator).apply_inverse(coarse.p, periodic)
    contact = np.empty(state.contact.shape, bool)
    transfer.copy(coarse.contact, contact)
    with state.pressure as values:
        target = values.reshape(state.u.shape)
        overlap = state.u - state.distance.b
        contact |= overlap <= 0
        contact &= state.admissible
        transfer.interpolate(periodic, target)
        np.subtract(target, overlap, out=target, where=contact)
        circulant_of(state.operator).apply(target, target)
        contact &= target > 0
        np.copyto(target, 0.0, where=~contact)
    state.contact[...] = contact
    before, after = state.sum(
        [coarse.operator.grid.cell_area * coarse.p.sum(), state.grid.cell_area * state.p.sum()]
    )
    return bool(before < _TRUSTED * after < _TRUSTED**2 * before)
