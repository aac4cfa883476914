"""Lift: the pressure of the next finer grid from displacements.

p = B T, B the inverse of A continued periodically and T the displacement that p causes on that patch. With p_H and u_H
of the coarse grid, T_H = B_H^-1 p_H and interpolation I:

1. T = I T_H on all cells of the fine grid.
2. C is that of the coarse grid and the cells with h + I u_H <= 0. There the gap shall be closed, u = -h; with the
   difference of periodic and true displacement on the coarse grid, T = -h + I (T_H - u_H).
3. p = B T; cells without p > 0 leave C.

Option ``-lcp_prolongation lift|copy``. For the gain see `app.methods.free`.
"""

from app.base.numba_cache import njit
from app.contact.kernels import gap
from app.methods.free.circulant import circulant_inverse

MAX_LOAD_RATIO = 20.0  # of the two grids, either way: otherwise p is copied


def lift(transfer, coarse, state):
    """Set C and p of `state` from the coarser grid.

    Collective. u of `state` is I u_H; u of the coarser grid is overwritten. Returns False if the loads differ so much
    that the coarse grid cannot be trusted.
    """
    circulant_inverse(coarse.operator).apply_inverse(coarse.p, coarse.u)  # T_H
    transfer.copy(coarse.contact, state.contact)
    p = state.values  # T until it is B T
    transfer.interpolate(coarse.u, p)  # 1.
    _close_gaps(state.distance.b, state.depth, state.u, state.admissible, state.contact, p)  # 2.
    circulant_inverse(state.operator).apply(p, p)  # 3.
    after = state.bounds.project(state.p, state.contact, p)
    state.contact &= state.bounds.between(p)
    areas = coarse.operator.grid.cell_area, state.grid.cell_area
    before, after = state.sum([areas[0] * coarse.p.sum(), areas[1] * after])
    return bool(before < MAX_LOAD_RATIO * after < MAX_LOAD_RATIO**2 * before)


@njit()
def _close_row(b, depth, u, admissible, contact, target):
    for i in range(b.size):
        e = gap(u[i], b[i], depth)
        inside = admissible[i] & (contact[i] | (e <= 0))
        contact[i] = inside
        target[i] -= e if inside else 0.0


@njit()
def _close_gaps(b, depth, u, admissible, contact, target):
    """Add overlapping cells to C; subtract h + u from `target` there."""
    for j in range(b.shape[0]):
        _close_row(b[j], depth, u[j], admissible[j], contact[j], target[j])
