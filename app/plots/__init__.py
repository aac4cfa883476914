"""Figures of results, surfaces, load paths and sweeps."""
