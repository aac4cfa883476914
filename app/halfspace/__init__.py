"""The influence matrix A of an elastic half-space (cells, coefficients, products, sweeps)."""
