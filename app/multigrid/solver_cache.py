"""Linear solvers that are kept from one solve to the next: those of small grids, and of the target."""

from __future__ import annotations

MAX_CACHED_CELLS = 256 * 256  # cells; what larger grids hold is no longer than it is needed


def is_large(grid):
    """Whether the memory of a grid or a window counts for more than what is made for it. Not collective."""
    return grid.n > MAX_CACHED_CELLS


class SolverCache:
    """Linear solvers of one hierarchy.

    Parameters
    ----------
    kind : type
        Of `LinearSolver`.
    hierarchy : Hierarchy
    target : LinearSolver or None
        Of the target grid, if there is one; its owner frees it.
    """

    def __init__(self, kind, hierarchy, target=None):
        self._kind, self._hierarchy, self._target, self._solvers = kind, hierarchy, target, {}

    def prepare(self, first=0):
        """Make now those of small grids that are worked on as a whole, from level `first` on. Collective."""
        hierarchy = self._hierarchy
        for number, level in enumerate(hierarchy.levels):
            as_whole = not (is_large(level.grid) or hierarchy.may_be_windowed(level))
            if number >= first and level.active and as_whole:
                self.solver(number, level)

    def solver(self, number, operator):
        """Linear solver of a level or of a window of it, made when first asked for. Collective over its ranks."""
        if self._is_of_target(operator):
            return self._target
        if operator not in self._solvers:
            self._solvers[operator] = self._kind(self._hierarchy, number, operator)
        return self._solvers[operator]

    def release_solver(self, operator):
        """Free the solver of a large grid or window, whose memory others need. Collective over its ranks."""
        if self._is_of_target(operator):
            self._target.rest()
        elif is_large(operator.grid):
            self._free_solver(operator)

    def _is_of_target(self, operator):
        return self._target is not None and operator is self._hierarchy.target

    def _free_solver(self, operator):
        if operator in self._solvers:
            self._solvers.pop(operator).destroy()

    def destroy(self):
        """Free them. Collective."""
        for solver in self._solvers.values():
            solver.destroy()
        self._solvers.clear()
