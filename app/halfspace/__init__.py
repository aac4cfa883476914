"""Floor 1: the influence matrix A of an elastic half-space (cells, coefficients, products, sweeps)."""
