"""What leaves the program: HDF5 results, pictures, tables."""
