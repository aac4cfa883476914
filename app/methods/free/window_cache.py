"""Cache of linear solvers and of operators of windows.

They depend on the number and size of cells, not on the place of a window. So a window of the same shape, at another
load or gap, needs no new spectra and no new PETSc objects. A large window with the same FFT length, as along a load
path, needs no new spectra.
"""

from app.halfspace.fft.multiplier import SpectrumCache
from app.halfspace.operator import InfluenceOperator
from app.methods.free.solver import TrackingSolver
from app.multigrid.direct import DirectSolver
from app.multigrid.solver_cache import SolverCache, is_large


class WindowCache(SolverCache):
    """Cache of solvers and window operators of a hierarchy. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    target : TrackingSolver or None
        Of the target grid; its owner frees it.
    """

    def __init__(self, hierarchy, target=None):
        super().__init__(TrackingSolver, hierarchy, target)
        self._windows, self._spectra, self._direct = {}, {}, {}

    def window(self, place, grid, slabs, comm, verification=None):
        """Return the operator of a window. Collective over `comm`.

        The last small window of each `place`, a hashable purpose, is cached. `verification`: its exact product.
        """
        operator = self._windows.get(place)
        if operator is None or (operator.grid.shape, operator.slabs.starts) != (grid.shape, slabs.starts):
            if operator is not None:
                self._free(self._windows.pop(place))
            hierarchy = self._hierarchy
            self._spectra[place] = spectra = SpectrumCache(self._spectra.get(place))
            shared = hierarchy.dtype, verification, hierarchy.target, spectra
            operator = InfluenceOperator(grid, hierarchy.compliance, slabs, comm, *shared)
            if not is_large(grid):
                self._windows[place] = operator
        elif verification is not None:
            operator.exact_product = verification  # until `close`: it holds a field of all cells
        operator.grid = grid
        return operator

    def direct(self, number, operator):
        """Return the direct solver of a level.

        This is the coarsest level, or a finer one if a gap has no admissible cell there.
        """
        if operator not in self._direct:
            self._direct[operator] = DirectSolver(operator, number)
        return self._direct[operator]

    def close(self, operator):
        """Count the products of a window; free it unless cached. Collective."""
        self._hierarchy.count_window(operator)
        operator.spectra.drop_unused()
        if operator in self._windows.values():
            operator.free_exact_product()
        else:
            self._free(operator)

    def reset_windows(self):
        """Count products of windows after an error; free exact products."""
        for operator in self._windows.values():
            self._hierarchy.count_window(operator)
            operator.free_exact_product()

    def _free(self, operator):
        self._free_solver(operator)
        operator.free()

    def destroy(self):
        """Free everything."""
        super().destroy()
        for solver in self._direct.values():
            solver.destroy()
        self._windows.clear()
        self._spectra.clear()
