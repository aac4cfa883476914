"""Geometry. What every contact problem offers: undeformed distance, admissible cells, material."""
