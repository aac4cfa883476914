"""Cache of linear solvers between solves.

The cache has the solvers of small grids and the solver of the target grid.
"""

from app.multigrid.direct import DirectSolver

MAX_CACHED_CELLS = 256 * 256  # largest number of cells of a grid or window whose solver is kept


def is_large(grid):
    """Return whether a grid is too large to cache its solver."""
    return grid.n > MAX_CACHED_CELLS


class SolverCache:
    """Cache of the linear solvers of one hierarchy.

    `kind` is the class of the solvers, `LinearSolver` or a subclass. `target` is the solver of the target grid, or
    None; the cache returns this solver, but does not free it. It may be set later.
    """

    def __init__(self, kind, hierarchy, target=None):
        self._kind, self._hierarchy, self.target = kind, hierarchy, target
        self._solvers, self._direct = {}, {}

    def prepare(self, first=0):
        """Make the solvers of small levels without windows, from `first` on. Collective."""
        hierarchy = self._hierarchy
        for number, level in enumerate(hierarchy.levels):
            is_cached = not (is_large(level.grid) or hierarchy.may_be_windowed(level))
            if number >= first and level.active and is_cached:
                self.solver(number, level)

    def solver(self, number, operator):
        """Get or make a level's or window's solver. Collective."""
        if self._is_of_target(operator):
            return self.target
        if operator not in self._solvers:
            self._solvers[operator] = self._kind(self._hierarchy, number, operator)
        return self._solvers[operator]

    def direct(self, number, operator):
        """Get or make the direct solver of level `number`.

        The level is the coarsest one, or a finer one if the coarsest has no admissible cell.
        """
        if operator not in self._direct:
            self._direct[operator] = DirectSolver(operator, number)
        return self._direct[operator]

    def release_solver(self, operator):
        """Free a large grid's solver; of the target only arrays. Collective."""
        if self._is_of_target(operator):
            self.target.free_work()
        elif is_large(operator.grid):
            self._free_solver(operator)

    def _is_of_target(self, operator):
        return self.target is not None and operator is self._hierarchy.target

    def _free_solver(self, operator):
        if operator in self._solvers:
            self._solvers.pop(operator).destroy()

    def destroy(self):
        """Free all cached solvers. Collective."""
        for solvers in (self._solvers, self._direct):
            for solver in solvers.values():
                solver.destroy()
            solvers.clear()
