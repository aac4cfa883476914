"""Distribution of grid rows over MPI ranks, and messages between ranks."""
