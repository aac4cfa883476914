"""Geometry: contact problems, base shapes, rough surfaces."""
