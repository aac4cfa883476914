"""Floor 1: analytic solutions of contact problems; depends on nothing else in the project."""

from app.reference.axisymmetric import AxisymmetricContact, Cone, FlatCircularPunch, Sphere
from app.reference.base import NormalContact
from app.reference.hertz import EllipticHertz

__all__ = [
    "AxisymmetricContact",
    "Cone",
    "EllipticHertz",
    "FlatCircularPunch",
    "NormalContact",
    "Sphere",
]
