"""Stress in the half-space below a surface pressure."""
