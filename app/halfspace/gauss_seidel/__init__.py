"""Exact Gauss-Seidel sweeps on a contact set: plans for compiled code, compiled loops, the sweeps."""
