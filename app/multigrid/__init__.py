"""Grids, and linear solvers for the masked system C A C p = b (2.11) on them.

`hierarchy` has the operators of all grids, `transfer` what goes between two of them. `linear_solver` is a KSP of one
system by PETSc's options. `pcmg` is the multigrid method (Sec. 4.2), a PC for any KSP; `direct` solves on the coarsest
grid. `kept` solvers serve one solve after the other.
"""

from app.multigrid.pcmg import ContactMG

__all__ = ["ContactMG"]
