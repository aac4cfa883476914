# Types of the names that app/reference/__init__.py imports when they are used.
from app.reference.axisymmetric import AxisymmetricContact as AxisymmetricContact
from app.reference.axisymmetric import Cone as Cone
from app.reference.axisymmetric import FlatCircularPunch as FlatCircularPunch
from app.reference.axisymmetric import Sphere as Sphere
from app.reference.base import NormalContact as NormalContact
from app.reference.capped import CappedLineContact as CappedLineContact
from app.reference.capped import CappedWestergaard as CappedWestergaard
from app.reference.hertz import EllipticHertz as EllipticHertz
from app.reference.periodic import Bisinusoidal as Bisinusoidal
from app.reference.periodic import WavyContact as WavyContact
from app.reference.periodic import Westergaard as Westergaard
from app.reference.periodic import full_contact_pressure as full_contact_pressure
from app.reference.rings import CappedSphere as CappedSphere
