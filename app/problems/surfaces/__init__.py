"""Measured surfaces: reading, levelling, filling, filters."""
