"""Stress below a pressure on the half-space."""
