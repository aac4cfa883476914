"""Default methods for free and periodic patches, and PETSc's own solvers."""
