"""What everything rests on: errors, MPI, PETSc, numba, memory, units. Knows nothing of contact."""
