"""Elastic normal contact of two bodies: full multigrid, active sets and FFTs on PETSc."""

__version__ = "0.1.0"
