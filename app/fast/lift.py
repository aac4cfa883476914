"""Lift: the pressure of the next finer grid from the displacement, by the FFT preconditioner (in place of copying p).

With the circulant matrix B^-1 for A, a displacement T that is known everywhere gives p = B T at the cost of an FFT:
on C it is -h, elsewhere the interpolated one of the coarse grid, both plus what the coarse grid says is the difference
of periodic and true displacement. First contact set: the coarse one and {h + u <= 0}, where p > 0.

Switch: ``-lcp_prolongation lift|copy``. Gain: see `app.fast`.
"""

from __future__ import annotations

from app.contact import kernels
from app.fast.circulant import circulant_of

_TRUSTED = (
    20.0  # factor in the load; a grid so coarse that it is missed by more says nothing, and copying is safer
)


def lift(transfer, coarse, state):
    """Set C and p of `state`, whose u is interpolated already; that of the coarser grid is written over.

    Collective.

    Returns
    -------
    bool
        False if the load came out so different that the coarse grid cannot be trusted; u is as it was.
    """
    circulant_of(coarse.operator).apply_inverse(coarse.p, coarse.u)
    transfer.copy(coarse.contact, state.contact)
    p = state.values
    transfer.interpolate(coarse.u, p)
    kernels.aim(state.distance.b, state.u, state.admissible, state.contact, p)
    circulant_of(state.operator).apply(p, p)
    after = kernels.keep_positive(p, state.contact)
    areas = coarse.operator.grid.cell_area, state.grid.cell_area
    before, after = state.sum([areas[0] * coarse.p.sum(), areas[1] * after])
    return bool(before < _TRUSTED * after < _TRUSTED**2 * before)
