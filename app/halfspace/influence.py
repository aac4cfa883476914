"""Influence coefficients of an elastic half-space, eqs. (2.4)-(2.6).

``A_IJ = (1 - nu) / (pi G) * integral over cell J of 1/rho``, rho the distance from the centre of cell I.
On equal cells A depends only on ``|ix - jx|`` and ``|iy - jy|``: everything is known from the *quadrant*
``K[j, i]``, the displacement i cells to the right of and j cells above a cell under unit pressure.

========================  ===========================  ==============
paper                     here                         unit
========================  ===========================  ==============
G, nu                     ``Material``                 N/mm2, 1
A_(0,0),(i,j)             ``quadrant[j, i]``           mm / (N/mm2)
(1 - nu) / (pi G)         ``Material.compliance``      mm2/N
========================  ===========================  ==============
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache, partial

import numpy as np

from app.compiled import njit
from app.errors import InputError
from app.halfspace.periodic import folded, periodic_quadrant

# The closed form subtracts numbers that are up to rho/cell times larger than their difference. From 8 cells on a
# Taylor series about the centre of the cell cancels nothing; its terms beyond order 12 sum up to less than 4e-17.
_CLOSED_FORM_UP_TO = 8.0
_ORDER = 12


def _real(what, value):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{what} {value!r}: needed: a number") from None


@dataclass(frozen=True)
class Material:
    """Combined elastic constants of the two bodies (Sec. 2.2).

    Parameters
    ----------
    shear_modulus : float
        G with 2/G = 1/G1 + 1/G2 [N/mm2]; a rigid body has 1/G1 = 0.
    poisson_ratio : float
        nu with 2 nu/G = nu1/G1 + nu2/G2, from 0 to 0.5.

    Attributes
    ----------
    known : mapping
        What it was made from, if not these two: ``young`` and ``poisson`` of both bodies; or nothing but E*.

    Notes
    -----
    Without friction only ``E* = G / (1 - nu)`` counts, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2: `from_contact_modulus`
    makes the material of G = E* and nu = 0.
    """

    shear_modulus: float
    poisson_ratio: float
    known: Mapping | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self):
        for name in ("shear_modulus", "poisson_ratio"):
            object.__setattr__(self, name, _real(name.replace("_", " "), getattr(self, name)))
        if not (np.isfinite(self.shear_modulus) and self.shear_modulus > 0):
            raise InputError(f"shear modulus {self.shear_modulus:g}: must be positive and finite")
        if not 0 <= self.poisson_ratio <= 0.5:
            raise InputError(f"Poisson ratio {self.poisson_ratio:g}: must be from 0 to 0.5")
        if not np.isfinite(self.compliance):
            raise InputError(f"shear modulus {self.shear_modulus:g}: too small, its reciprocal is infinite")

    @classmethod
    def combined(cls, shear_modulus, poisson_ratio):
        """Make it from G and nu of the pair. Not collective."""
        return cls(shear_modulus, poisson_ratio)

    @classmethod
    def pair(cls, young, poisson):
        """Make it from Young's moduli and Poisson's ratios of the two bodies. Not collective.

        Parameters
        ----------
        young : pair of float
            E1, E2 [N/mm2]; inf for a rigid body.
        poisson : pair of float
            nu1, nu2, each from 0 to 0.5; that of a rigid body does not count.

        Raises
        ------
        InputError
            If a number is out of range, or both bodies are rigid.

        Examples
        --------
        >>> steel_on_polymer = Material.pair((210e3, 3e3), (0.3, 0.35))
        >>> round(steel_on_polymer.contact_modulus)
        3369
        """
        try:
            young, poisson = (tuple(map(float, pair)) for pair in (young, poisson))
        except (TypeError, ValueError):
            raise InputError(
                "pair: needed: two Young's moduli and two Poisson's ratios, (E1, E2), (nu1, nu2)"
            ) from None
        if not (len(young) == 2 and all(modulus > 0 for modulus in young)):
            raise InputError(
                f"Young's moduli {_listed(young)}: needed: two positive numbers; inf: a rigid body"
            )
        if not (len(poisson) == 2 and all(0 <= ratio <= 0.5 for ratio in poisson)):
            raise InputError(f"Poisson's ratios {_listed(poisson)}: needed: two numbers from 0 to 0.5")
        if all(map(math.isinf, young)):
            raise InputError("Young's moduli inf,inf: one body at least must be elastic")
        soft = [2 * (1 + ratio) / modulus for modulus, ratio in zip(young, poisson, strict=True)]  # 1/G
        ratio = sum(one * other for one, other in zip(soft, poisson, strict=True)) / sum(soft)
        return cls(2 / sum(soft), ratio)._knowing(young=young, poisson=poisson)

    @classmethod
    def from_contact_modulus(cls, contact_modulus):
        """Make it from E* alone [N/mm2]. Not collective.

        Examples
        --------
        >>> Material.from_contact_modulus(25.0).describe()
        {'contact_modulus': 25.0}
        """
        contact_modulus = _real("contact modulus", contact_modulus)
        if not (np.isfinite(contact_modulus) and contact_modulus > 0):
            raise InputError(f"contact modulus {contact_modulus:g}: must be positive and finite")
        return cls(contact_modulus, 0.0)._knowing()

    def _knowing(self, **known):
        object.__setattr__(self, "known", known)
        return self

    def describe(self):
        """Moduli for the result file: E*, and those of the pair and the bodies that are known. Not collective."""
        facts = (
            {}
            if self.known == {}
            else {"shear_modulus": self.shear_modulus, "poisson_ratio": self.poisson_ratio}
        )
        bodies = {name: list(values) for name, values in (self.known or {}).items()}
        return {**facts, **bodies, "contact_modulus": self.contact_modulus}

    @property
    def compliance(self):
        """(1 - nu) / (pi G), the factor of 1/rho in (2.5) [mm2/N]."""
        return (1 - self.poisson_ratio) / (np.pi * self.shear_modulus)

    @property
    def contact_modulus(self):
        """E* = G / (1 - nu) [N/mm2]."""
        return self.shear_modulus / (1 - self.poisson_ratio)


def _listed(numbers):
    return ",".join(f"{number:g}" for number in numbers)


@lru_cache(maxsize=64)
def _taylor_series(dx, dy):
    """Mean of 1/rho over a cell whose centre is at (x, y); lengths in units of the longer side.

    Returns
    -------
    (float, float), (float, float)
        Sides of the cell, and their squares, both correctly rounded.
    ndarray, shape (_ORDER / 2 + 1, _ORDER / 2 + 1)
        c with ``mean = sum_nk c[n, k] y^2k r^-(2n+2k+1)``, ``r^2 = x^2 + y^2``; order 2n of the series in row n.
    """
    sides = [Fraction(side) / Fraction(max(dx, dy)) for side in (dx, dy)]
    n, k = np.indices((_ORDER // 2 + 1,) * 2)
    s = 2 * (n + k) + 1
    # The second derivative of y^2k r^-s in x, and in y: factors of y^(2k+2q) r^-(s+2+2q), q = -1, 0, 1.
    in_x = 0 * s, s * (s + 1), -s * (s + 2)
    in_y = 2 * k * (2 * k - 1), -s * (4 * k + 1), s * (s + 2)
    mean = np.zeros(s.shape)
    mean[0, 0] = 1
    for side, (before, same, after) in zip(sides, (in_x, in_y), strict=True):
        term = mean
        for p in range(1, len(mean)):
            derivative = np.zeros(s.shape)
            derivative[1:, :-1] = (before * term)[:-1, 1:]
            derivative[1:] += (same * term)[:-1]
            derivative[1:, 1:] += (after * term)[:-1, :-1]
            term = derivative * float(side**2 / (8 * p * (2 * p + 1)))
            mean = mean + term
    return tuple(map(float, sides)), tuple(float(side**2) for side in sides), mean


@njit()
def _edge(distance, i, length):
    """Integral of 1/rho along an edge, from i - 1/2 to i + 1/2 lengths on a line at a distance from the origin."""
    low, high = (i - 0.5) * length, (i + 0.5) * length
    if i == 0:
        return 2 * math.asinh(high / abs(distance))
    r_low, r_high = math.sqrt(distance**2 + low**2), math.sqrt(distance**2 + high**2)
    return math.log1p(length * (1 + 2 * i * length / (r_low + r_high)) / (low + r_low))


@njit(error_model="numpy", fastmath={"contract"})
def _fill(quadrant, offsets, sides, squares, series, near, far):
    """Rows `offsets` of the quadrant, (2.4) for a cell under unit pressure: `near` times the integral of 1/rho, or
    `far` times the mean.

    The integral is that of ``div(r / rho)``: a sum over edges, their signed distance times the integral of 1/rho.
    """
    columns = quadrant.shape[1]
    dx, dy = sides
    x_squared = squares[0] * np.arange(columns) ** 2
    coefficients = np.empty(_ORDER + 1)
    for index in range(len(offsets)):
        j, row = offsets[index], quadrant[index]
        y_squared = squares[1] * j**2
        south, north = (j - 0.5) * dy, (j + 0.5) * dy
        west = -0.5 * dx * _edge(0.5 * dx, j, dy)
        i = 0
        while i < columns and x_squared[i] + y_squared < _CLOSED_FORM_UP_TO**2:
            x = (i + 0.5) * dx
            east = x * _edge(x, j, dy)
            row[i] = near * (east - west + north * _edge(north, i, dx) - south * _edge(south, i, dx))
            west = east
            i += 1
        # Along a row the series is a polynomial of 1/r^2.
        coefficients[:] = 0
        for n in range(len(series)):
            y_power = far
            for k in range(n + 1):
                coefficients[n + k] += series[n, k] * y_power
                y_power *= y_squared
        x_rest, rest = x_squared[i:], row[i:]
        for m in range(len(rest)):
            inverse = 1 / math.sqrt(x_rest[m] + y_squared)
            total = coefficients[_ORDER]
            for n in range(_ORDER - 1, -1, -1):
                total = total * (inverse * inverse) + coefficients[n]
            rest[m] = total * inverse


def influence_quadrant(grid, compliance, rows=slice(None), columns=None):
    """Influence coefficients at all offsets with non-negative components.

    Not collective.

    Parameters
    ----------
    grid : Grid
        If it is periodic, images are counted in.
    compliance : float
        (1 - nu) / (pi G) [mm2/N].
    rows : slice
        Offsets in y to compute, out of 0 .. ny-1.
    columns : int, optional
        Number of offsets in x to compute, from 0 on; default: nx.

    Returns
    -------
    ndarray, shape (number of rows, columns), [mm / (N/mm2)]
    """
    if grid.periodic:
        return quadrant_rows(grid, compliance)(rows, columns)
    return _coefficients(grid, compliance, np.arange(grid.ny)[rows], grid.nx if columns is None else columns)


def influence_at(grid, rows, columns):
    """Influence coefficients for unit compliance at any offsets, shape (rows, columns) [mm2]. Not collective.

    `rows`, `columns`: arrays of numbers of cells, 0 or more.
    """
    return _coefficients(grid, 1.0, rows, int(columns.max()) + 1)[:, columns]


def _coefficients(grid, compliance, rows, columns):
    """At offsets `rows`, and 0 .. columns-1."""
    quadrant = np.empty((len(rows), columns))
    sides, squares, series = _taylor_series(grid.dx, grid.dy)
    scales = float(compliance * max(grid.dx, grid.dy)), float(compliance * min(grid.dx, grid.dy))
    _fill(quadrant, rows, sides, squares, series, *scales)
    return quadrant


def quadrant_rows(grid, compliance):
    """Return ``rows(slice, columns=None)``, which is `influence_quadrant` for who asks often. Not collective.

    On a periodic grid no row comes without all of them: they are computed once, and kept in a quarter of a field.
    """
    if not grid.periodic:
        return partial(influence_quadrant, grid, compliance)
    quadrant = periodic_quadrant(grid, compliance)

    def rows(which=slice(None), columns=None):
        wanted = np.arange(grid.nx if columns is None else columns)
        return quadrant[np.ix_(folded(np.arange(grid.ny)[which], grid.ny), folded(wanted, grid.nx))]

    return rows


def dense_matrix(grid, compliance):
    """The influence matrix itself, shape (n, n): for coarsest grids and checks. Not collective."""
    quadrant = influence_quadrant(grid, compliance)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    dj, di = np.abs(j[:, None] - j), np.abs(i[:, None] - i)
    return quadrant[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)
