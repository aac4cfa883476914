"""Theories of the contact fraction of rough surfaces.

The relative pressure p' is the mean pressure over E* times the rms slope.
"""

import numpy as np


def persson_fraction(relative):
    """Return Persson's contact fraction for a relative pressure p'.

    p' is the mean pressure over E* times the rms slope. See J. Chem. Phys. 115 (2001) 3840.
    """
    from scipy.special import erf

    return erf(np.sqrt(2) * np.asarray(relative, float))


def persson_pressure(fraction):
    """Return the relative pressure p' for a contact fraction.

    This is Persson's theory, and the inverse of `persson_fraction`.

    Examples
    --------
    >>> float(persson_pressure(persson_fraction(0.125)))
    0.125
    """
    from scipy.special import erfinv

    return erfinv(np.asarray(fraction, float)) / np.sqrt(2)


def bush_gibson_thomas_fraction(relative):
    """Return the contact fraction of Bush, Gibson and Thomas, sqrt(2 pi) p'.

    It holds for small relative pressures p' (Wear 35 (1975) 87). NaN where it would exceed 1.
    """
    fraction = np.sqrt(2 * np.pi) * np.asarray(relative, float)
    return np.where(fraction <= 1, fraction, np.nan)
