"""Grids, and linear solvers of the masked system (2.11).

`hierarchy` has the operators of all grids. `transfer` has restriction and prolongation between two grids,
`interpolation` their loops. `pcmg` is the multigrid method (Sec. 4.2), a PC for any KSP. `smoothers` has smoothers that
PETSc does not have. `direct` solves on the coarsest grid. `linear_solver` sets up a KSP by PETSc's options,
`ksp_context` is the base class of this program's KSPs, and `solver_cache` keeps linear solvers between solves.
"""

from app.multigrid.pcmg import ContactMG

__all__ = ["ContactMG"]
