"""Direct solver of the coarsest grid, step 1 of Sec. 4.3."""

import numpy as np
from petsc4py import PETSc
from scipy.linalg.lapack import dpotrf, dpotrs

from app.base.errors import InputError
from app.base.numba_cache import njit
from app.multigrid.hierarchy import MAX_DIRECT_CELLS


def solves_directly(operator):
    """Return whether one rank holds the whole, small grid."""
    return operator.slabs.size == 1 and operator.grid.n <= MAX_DIRECT_CELLS


def can_start_on(hierarchy, number):
    """Return whether a level is small, and coarser than the target."""
    return number < len(hierarchy.levels) - 1 and hierarchy.levels[number].grid.n <= MAX_DIRECT_CELLS


def starts_directly(hierarchy, number):
    """Return whether a first level with this `number` is solved directly."""
    return can_start_on(hierarchy, number) and solves_directly(hierarchy.levels[number])


def stored_matrix(operator):
    """Return the dense A of a small grid; empty on ranks without rows.

    Raises InputError if the grid is too large, or on several ranks.
    """
    grid = operator.grid
    if not solves_directly(operator):
        what, most = f"a coarsest grid of {grid.nx} x {grid.ny} cells is", MAX_DIRECT_CELLS
        if grid.n > most:
            raise InputError(f"{what} too large for a direct solve; it must have at most {most} cells")
        advice = "use a larger -lcp_cells_per_rank, or more -pc_mg_levels"
        raise InputError(f"{what} on {operator.slabs.size} ranks, a direct solve is on one; {advice}")
    if not operator.active:
        return np.empty((0, 0))
    return operator.matrix()


@njit()
def _cut(matrix, cells, system):
    """Copy A's lower triangle on `cells` to `system`."""
    for i in range(cells.size):
        row = matrix[cells[i]]
        for j in range(i + 1):
            system[i, j] = row[cells[j]]


class DirectSolver:
    """Cholesky solver of C A C x = b.

    C is the contact set, the mask of the operator. The grid has at most `MAX_DIRECT_CELLS` cells; `level` is its number
    in the hierarchy.
    """

    work_units = 0.0

    def __init__(self, operator, level=0):
        self.level, self.operator = level, operator
        self._matrix = stored_matrix(operator)
        self._work = PETSc.Vec().createSeq(operator.grid.n)
        self._cells = self._factors = None
        self._failure = ""

    def set_contact(self):
        """Factorise A on the contact set."""
        self.operator.mask_changed()
        cells = np.flatnonzero(self.operator.mask)
        if self._cells is not None and cells.tobytes() == self._cells.tobytes():
            return
        system = np.empty((len(cells), len(cells)))
        _cut(self._matrix, cells, system)
        self._cells = cells
        self._factors, failed = dpotrf(system.T, clean=False, overwrite_a=True) if len(cells) else (system, 0)
        self._failure = "the influence matrix of the contact set is not positive definite" if failed else ""

    def solve(self, b, allowed=0.0):
        """Solve C A C x = b by Cholesky factors; see `LinearSolver.solve`."""
        right = b.getArray(readonly=True)[self._cells]
        with self._work as x:
            x[...] = 0
            if len(right) and not self._failure:
                x[self._cells] = dpotrs(self._factors, right)[0]
        return self._work, 1, self._failure

    def destroy(self):
        """Free the work vector."""
        self._work.destroy()
