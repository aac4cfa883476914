"""Default methods of free and periodic patches, and PETSc's own solvers."""
