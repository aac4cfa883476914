"""The default methods, what they share, and PETSc's own solvers."""
