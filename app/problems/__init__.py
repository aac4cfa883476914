"""Floor 1: geometry. What every contact problem offers: undeformed distance, admissible cells, material."""
