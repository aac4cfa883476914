"""Floor 2: what leaves the program: HDF5 results, pictures, tables."""
