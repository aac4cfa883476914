"""Distribution of grid rows over MPI ranks, and the communication between ranks."""
