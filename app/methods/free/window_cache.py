"""Cache of linear solvers and window operators.

Solvers and operators depend on the number and size of cells, not on the place of a window. So a window of the same
shape needs no new spectra and no new PETSc objects. A large window is not cached, but its spectra are used again for
the next window with the same FFT length, for example in the next step of a load path.
"""

from app.halfspace.fft.multiplier import SpectrumCache
from app.halfspace.operator import InfluenceOperator
from app.methods.free.solver import TrackingSolver
from app.multigrid.solver_cache import SolverCache, is_large


class WindowCache(SolverCache):
    """Cache of a hierarchy's solvers and window operators. Collective.

    Parameters
    ----------
    hierarchy : Hierarchy
    target : TrackingSolver or None
        Solver of the target grid, which is not freed here.
    """

    def __init__(self, hierarchy, target=None):
        super().__init__(TrackingSolver, hierarchy, target)
        self._windows, self._spectra = {}, {}

    def window(self, place, grid, slabs, comm, verification=None):
        """Return the operator of a window. Collective over `comm`.

        `place` is a hashable key for the purpose of the window; the last small window of each key is cached. `grid` is
        the grid of the window, `slabs` its distribution. `verification` is its VerificationProduct on the target grid.
        """
        operator = self._windows.get(place)
        if operator is None or (operator.grid.shape, operator.slabs.starts) != (grid.shape, slabs.starts):
            if operator is not None:
                self._free(self._windows.pop(place))
            hierarchy = self._hierarchy
            self._spectra[place] = spectra = SpectrumCache(self._spectra.get(place))
            shared = hierarchy.dtype, verification, hierarchy.target, spectra
            operator = InfluenceOperator(grid, hierarchy.kernel, slabs, comm, *shared)
            if not is_large(grid):
                self._windows[place] = operator
        elif verification is not None:
            operator.exact_product = verification  # until `close`: it holds a field of all cells
        operator.grid = grid
        return operator

    def close(self, operator):
        """Finish with a window: count its work, and free its operator. Collective.

        The products since the last count are added to the work of the hierarchy. A cached operator is not freed.
        """
        self._hierarchy.count_window(operator)
        operator.spectra.drop_unused()
        if operator in self._windows.values():
            operator.free_exact_product()
        else:
            self._free(operator)

    def reset_windows(self):
        """Close all cached windows after an error."""
        for operator in self._windows.values():
            self._hierarchy.count_window(operator)
            operator.free_exact_product()

    def _free(self, operator):
        self._free_solver(operator)
        operator.free()

    def destroy(self):
        """Free all solvers and window operators."""
        super().destroy()
        self._windows.clear()
        self._spectra.clear()
