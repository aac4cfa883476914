"""Influence matrix A of an elastic half-space on cells.

A maps the pressures on all cells to their displacements: u = A p.
"""
