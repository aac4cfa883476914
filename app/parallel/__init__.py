"""Distribution of rows over MPI ranks, and their communication."""
