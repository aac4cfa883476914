"""Floor 1: analytic solutions of contact problems; depends on nothing else in the project."""
