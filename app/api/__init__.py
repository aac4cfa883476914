"""Python interface: solver, solution, load paths, refinement."""
