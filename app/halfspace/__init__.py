"""Influence matrix A of an elastic half-space, on grids of cells.

A maps the pressures on all cells to their displacements: u = A p.
"""
