"""The complementarity problem (Sec. 2.3) and what is said of its solution, whatever solves it.

- *The problem.* `distance` is h, `bounds` what the pressure may be, `loading` what is prescribed; `state` has C, p and
  u, and the steps of Sec. 4.1 on them (loops: `kernels`, `bounds_kernels`).
- *The paper's iteration.* `iteration` puts the steps in order, around any KSP; `stopping` is (5.1). `full_multigrid`
  goes through the grids (Sec. 4.3), `visits` has what all nested iterations share. `full_contact` is tried first on
  periodic patches. `reference_solvers` are PETSc's own.
- *The result.* `certificate` proves it; `measures` and `extent` are numbers of it, `grid_errors` what the size of the
  cells makes of these; `history` has a row for each iteration.
"""
