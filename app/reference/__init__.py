"""Analytic solutions of contact problems; depends on nothing else in the project but its errors.

Each name brings its module when it is first asked for: their special functions take long to load.
"""

from importlib import import_module

_PLACES = {
    "AxisymmetricContact": "axisymmetric",
    "Bisinusoidal": "periodic",
    "Cone": "axisymmetric",
    "EllipticHertz": "hertz",
    "FlatCircularPunch": "axisymmetric",
    "NormalContact": "base",
    "Sphere": "axisymmetric",
    "WavyContact": "periodic",
    "Westergaard": "periodic",
    "full_contact_pressure": "periodic",
}
__all__ = list(_PLACES)


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = found  # is here from now on
    return found


def __dir__():
    return __all__
