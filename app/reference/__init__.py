"""Floor 1: analytic solutions of contact problems; depends on nothing else in the project."""

from app.reference.axisymmetric import AxisymmetricContact, Cone, FlatCircularPunch, Sphere
from app.reference.base import NormalContact
from app.reference.hertz import EllipticHertz
from app.reference.periodic import Bisinusoidal, WavyContact, Westergaard, full_contact_pressure

__all__ = [
    "AxisymmetricContact",
    "Bisinusoidal",
    "Cone",
    "EllipticHertz",
    "FlatCircularPunch",
    "NormalContact",
    "Sphere",
    "WavyContact",
    "Westergaard",
    "full_contact_pressure",
]
