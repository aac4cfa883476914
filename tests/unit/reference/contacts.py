"""Analytic contacts that the tests of this folder share."""

import numpy as np

from app.reference import Cone, EllipticHertz, FlatCircularPunch, Sphere

E_STAR = 82000 / 0.72  # the paper's steel: G / (1 - nu)
CASES = {
    "paper": (EllipticHertz, (300.0, 163.0)),
    "long in y": (EllipticHertz, (20.0, 900.0)),
    "circular": (EllipticHertz, (40.0, 40.0)),
    "sphere": (Sphere, (40.0,)),
    "punch": (FlatCircularPunch, (3.0,)),
    "cone": (Cone, (0.02,)),
}


def contact(kind, geometry, approach=0.1091):
    return kind.from_approach(*geometry, E_STAR, approach)


def points(c, radii):
    """Points on ellipses of `radii` times the contact ellipse, none on a symmetry line."""
    angle = np.array([0.1, 0.8, 1.4, 2.5, 4.0])
    radii = np.asarray(radii)[:, None]
    return c.a * radii * np.cos(angle), c.b * radii * np.sin(angle)
