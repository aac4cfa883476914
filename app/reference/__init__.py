"""Analytic solutions of contact problems.

A name is imported when it is first used, because special functions load slowly.
"""

from importlib import import_module

_MODULES = {
    "AxisymmetricContact": "axisymmetric",
    "Bisinusoidal": "periodic",
    "CappedLineContact": "capped",
    "CappedSphere": "rings",
    "CappedWestergaard": "capped",
    "Cone": "axisymmetric",
    "EllipticHertz": "hertz",
    "FlatCircularPunch": "axisymmetric",
    "NormalContact": "base",
    "Sphere": "axisymmetric",
    "WavyContact": "periodic",
    "Westergaard": "periodic",
    "full_contact_pressure": "periodic",
}
__all__ = list(_MODULES)


def __getattr__(name):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    return value


def __dir__():
    return __all__
