"""Lift: prolongation of the pressure to a finer grid, by displacements.

B is the inverse of the periodic continuation of A. The pressure p of the fine grid is computed as p = B T, where T is
the displacement by p on the periodic patch. The coarse grid has the pressure p_H, the displacement u_H, and T_H =
B_H^-1 p_H. I is the interpolation to the fine grid:

1. T = I T_H on all cells of the fine grid.
2. The contact set C consists of the contact cells of the coarse grid and of the cells with h + I u_H <= 0. In C the gap
   must close, u = -h. T differs from u by T_H - u_H, which is known on the coarse grid, so T = -h + I (T_H - u_H).
3. p = B T. Cells with p <= 0 leave C.

Cells that become plastic in a local Jacobi step are not in C, and have p = H.

Option ``-lcp_prolongation lift|copy``. For the gain see `app.methods.free`.
"""

from app.base.numba_cache import njit
from app.contact.loops import gap
from app.methods.free.circulant import circulant_inverse

MAX_LOAD_RATIO = 20.0  # largest ratio of the loads of the two grids, either way; above it p is copied


def lift(transfer, coarse, state):
    """Set contact set and pressure of `state` from the coarser grid.

    Collective. On entry u of `state` must be the interpolated displacement of the coarser grid; `coarse.u` is
    overwritten. Return False if the coarse grid is too inaccurate: then the loads of both grids differ much.
    """
    circulant_inverse(coarse.operator).apply_inverse(coarse.p, coarse.u)  # T_H
    transfer.copy(coarse.contact, state.contact)
    p, bounds, closable, plastic = state.values, state.bounds, state.admissible, None
    if bounds.capped:
        transfer.copy(coarse.p, p)
        plastic = state.admissible & ~state.contact & (p > 0)
        if plastic.any():
            plastic &= state.gap() < 0
            closable = closable & ~plastic
    transfer.interpolate(coarse.u, p)  # 1. p stores T until 3.
    _close_gaps(state.distance.b, state.depth, state.u, closable, state.contact, p)  # 2.
    circulant_inverse(state.operator).apply(p, p)  # 3.
    after = bounds.project_sets(p, state.contact, plastic)
    state.contact &= bounds.between(p)
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
    """Add overlapping cells to contact; close the gaps of contact cells.

    `target` is the wanted displacement on the periodic patch. In contact cells the gap h + u is subtracted from it.
    """
    for j in range(b.shape[0]):
        _close_row(b[j], depth, u[j], admissible[j], contact[j], target[j])
