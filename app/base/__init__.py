"""Functions without contact mechanics: errors, MPI, PETSc, numba, memory and units."""
