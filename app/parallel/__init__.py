"""Distribution of grid rows over MPI ranks, and their communication."""
