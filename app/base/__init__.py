"""Errors, MPI, PETSc, numba, memory and units; nothing of contact."""
