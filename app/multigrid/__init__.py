"""Grids, and linear solvers for the masked system C A C p = b (2.11) on them.

`hierarchy` has the operators of all grids, `transfer` what goes between two of them. `linear_solver` is a KSP of one
system by PETSc's options; with -pc_type mg `pcmg` gives PETSc's PCMG the operators and transfers (Sec. 4.2), and
`direct` solves on the coarsest grid. `kept` solvers serve one solve after the other.
"""
