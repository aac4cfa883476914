"""What is kept between solves: linear solvers, small windows' operators with theirs, spectra of large windows.

What these depend on is the number and the size of their cells, not where a window lies. So another solve that looks
through a window of the same shape, at another load or another gap, makes no spectra and no objects of PETSc's; and a
large window that is transformed by the same periods, as along a load path, makes no spectra.
"""

from __future__ import annotations

from app.halfspace.fft.multiplier import SpectrumCache
from app.halfspace.operator import InfluenceOperator
from app.methods.free.solver import TrackingSolver
from app.multigrid.direct import DirectSolver
from app.multigrid.solver_cache import SolverCache, is_large


class WindowCache(SolverCache):
    """`SolverCache`, direct ones, and operators of windows, of one hierarchy.

    Parameters
    ----------
    hierarchy : Hierarchy
    target : TrackingSolver or None
        Of the target grid, if there is one; its owner frees it.
    """

    def __init__(self, hierarchy, target=None):
        super().__init__(TrackingSolver, hierarchy, target)
        self._windows, self._spectra, self._direct = {}, {}, {}

    def window(self, place, grid, slabs, comm, verification=None):
        """Operator of a window, ready for another contact set. Collective over `comm`.

        Parameters
        ----------
        place : hashable
            What the window is for; the last one of every place is kept, if it is small.
        grid, slabs, comm
            See `InfluenceOperator`.
        verification : optional
            Its exact product.
        """
        kept = self._windows.get(place)
        if kept is None or (kept.grid.shape, kept.slabs.starts) != (grid.shape, slabs.starts):
            if kept is not None:
                self._free(self._windows.pop(place))
            hierarchy = self._hierarchy
            self._spectra[place] = spectra = SpectrumCache(self._spectra.get(place))
            shared = hierarchy.dtype, verification, hierarchy.target, spectra
            kept = InfluenceOperator(grid, hierarchy.compliance, slabs, comm, *shared)
            if not is_large(grid):
                self._windows[place] = kept
        elif verification is not None:
            kept.exact_product = verification  # until it is closed: it holds a field of all cells
        kept.grid = grid
        return kept

    def direct(self, number, operator):
        """Direct solver of a level, made when first asked for. Not collective.

        Of the coarsest one; where a gap has no admissible cell there, of a finer one.
        """
        if operator not in self._direct:
            self._direct[operator] = DirectSolver(operator, number)
        return self._direct[operator]

    def close(self, operator):
        """Count what was computed in a window, and free it unless it is kept. Collective over its ranks."""
        self._hierarchy.count_window(operator)
        operator.spectra.forget()
        if operator in self._windows.values():
            operator.free_exact_product()
        else:
            self._free(operator)

    def abandon(self):
        """Count what an interrupted solve has computed in windows that are kept, and free what they hold of all cells.

        Not collective.
        """
        for operator in self._windows.values():
            self._hierarchy.count_window(operator)
            operator.free_exact_product()

    def _free(self, operator):
        self._free_solver(operator)
        operator.free()

    def destroy(self):
        """Free everything. Collective."""
        super().destroy()
        for solver in self._direct.values():
            solver.destroy()
        self._windows.clear()
        self._spectra.clear()
