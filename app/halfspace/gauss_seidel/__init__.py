"""Exact lexicographic Gauss-Seidel sweeps on a contact set."""
