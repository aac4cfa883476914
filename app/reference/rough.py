"""Theories of the contact fraction of rough surfaces, at p' = mean pressure / (E* rms slope)."""

from __future__ import annotations

import numpy as np


def persson_fraction(relative):
    """Persson, J. Chem. Phys. 115 (2001) 3840: contact fraction at any p'. Not collective."""
    from scipy.special import erf

    return erf(np.sqrt(2) * np.asarray(relative, float))


def persson_pressure(fraction):
    """The p' of which `persson_fraction` is this. Not collective.

    Examples
    --------
    >>> float(persson_pressure(persson_fraction(0.125)))
    0.125
    """
    from scipy.special import erfinv

    return erfinv(np.asarray(fraction, float)) / np.sqrt(2)


def bush_gibson_thomas_fraction(relative):
    """Bush, Gibson, Thomas, Wear 35 (1975) 87: contact fraction at small p'; NaN above 1. Not collective."""
    fraction = np.sqrt(2 * np.pi) * np.asarray(relative, float)
    return np.where(fraction <= 1, fraction, np.nan)
