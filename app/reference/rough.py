"""Theories of the contact fraction of rough surfaces.

The relative pressure p' is the mean pressure divided by E* times the rms slope.
"""

import numpy as np


def persson_fraction(relative):
    """Return Persson's contact fraction for a relative pressure p'.

    p' is the mean pressure divided by E* times the rms slope. See J. Chem. Phys. 115 (2001) 3840.
    """
    from scipy.special import erf

    return erf(np.sqrt(2) * np.asarray(relative, float))


def persson_pressure(fraction):
    """Return the relative pressure p' for a contact fraction.

    This function is the inverse of `persson_fraction`.

    Examples
    --------
    >>> float(persson_pressure(persson_fraction(0.125)))
    0.125
    """
    from scipy.special import erfinv

    return erfinv(np.asarray(fraction, float)) / np.sqrt(2)


def bush_gibson_thomas_fraction(relative):
    """Return the contact fraction of Bush, Gibson and Thomas, sqrt(2 pi) p'.

    The theory is valid for small relative pressures p' (Wear 35 (1975) 87). NaN if it would exceed 1.
    """
    fraction = np.sqrt(2 * np.pi) * np.asarray(relative, float)
    return np.where(fraction <= 1, fraction, np.nan)


def persson_hardness_fractions(relative, hardness):
    """Return open, elastic and plastic fractions by Persson's theory.

    `relative` is p', the mean pressure, and `hardness` the largest pressure; both are divided by E* times the rms
    slope. For an infinite hardness, the elastic fraction is `persson_fraction`. NaN where p' exceeds the hardness. In
    the theory the distribution of the pressure diffuses between two absorbing walls, 0 and the hardness. See B.N.J.
    Persson, Phys. Rev. Lett. 87 (2001) 116101.

    Examples
    --------
    >>> [round(float(f), 4) for f in persson_hardness_fractions(0.5, 1.0)]
    [0.3146, 0.3708, 0.3146]
    """
    from scipy.special import erfc

    p, limit = np.broadcast_arrays(np.asarray(relative, float), np.asarray(hardness, float))
    p, limit = np.where((p >= 0) & (p <= limit), p, np.nan), np.where(limit > 0, limit, np.nan)
    n = np.arange(1, 9).reshape(-1, *[1] * p.ndim)
    # Waves converge fast between near walls, images between far ones.
    near, far = np.minimum(limit, 1.0), np.minimum(limit, p + 30.0)
    share = np.minimum(p / near, 1.0)
    b = 2 / (n * np.pi) * np.sin(n * np.pi * share) * np.exp(-((n * np.pi / near) ** 2) / 8)
    images = [
        erfc(np.sqrt(2) * (2 * n * far - 2 * far + start)) - erfc(np.sqrt(2) * (2 * n * far - start))
        for start in (p, far - p)
    ]
    opened = np.where(limit < 1, 1 - share - b.sum(axis=0), images[0].sum(axis=0))
    plastic = np.where(limit < 1, share + ((-1.0) ** n * b).sum(axis=0), images[1].sum(axis=0))
    return opened, 1 - opened - plastic, plastic
