"""Contact with a hardness H, the largest pressure (elastic, perfectly plastic).

Where p = H the bodies overlap by the plastic depth w, which is the part that flows. Contact is at ``|x| < a``, plastic
contact at ``|x| < c``. The derivative u'' of the displacement is 2 / (pi E*) times the integral of p' / (s - x).
Let e = h + u be the gap. Consider the analytic function whose real part is e'' and whose imaginary part is 2 p' / E*.
This function has a square root at each edge::

    p' = -P / (pi sqrt((x^2 - c^2) (a^2 - x^2))),      e'' = 2 P / (pi E*) / (+-sqrt((x^2 - c^2) (x^2 - a^2)))

where the sign is - at ``|x| < c`` and + at ``|x| > a``. P is a polynomial in x^2. P is known from h'', except for its
constant g, which follows from e' = 0 at x = c. For waves, x is replaced by sin(pi x / L), and P has one more power.

The substitutions x = a dn(v) in elastic and x = c sn(v) in plastic contact make dx / sqrt(...) = dv / a.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipkinc, ellipkm1

from app.base.errors import InputError, format_exact
from app.base.types import ArrayLike, Floats
from app.reference.base import require_hardness, require_positive
from app.reference.periodic import Westergaard

_NODES, _WEIGHTS = (np.polynomial.legendre.leggauss(80) + np.array([[1.0], [0.0]])) / 2  # on (0, 1)
_LEAST_LOG = -650.0  # of 1 - (c/a)^2; next to the smallest double


@dataclass(frozen=True)
class CappedLineContact:
    """Plane contact of a long cylinder with a hardness.

    The undeformed distance is the parabola x^2/(2 radius). All numbers are known in closed form.

    Parameters
    ----------
    radius : float
        Relative radius R [mm].
    e_star, hardness : float
        Contact modulus E* and largest pressure H [N/mm2]; H may be infinite.
    load : float
        Normal force per length [N/mm].

    Examples
    --------
    >>> contact = CappedLineContact(radius=10, e_star=1e5, hardness=1500, load=1000)
    >>> round(contact.a, 4), round(contact.c, 4)
    (0.3685, 0.281)
    """

    radius: float
    e_star: float
    hardness: float
    load: float

    def __post_init__(self):
        require_positive(radius=self.radius, e_star=self.e_star, load=self.load)
        require_hardness(self.hardness)

    @property
    def elastic_load(self) -> float:
        """Largest load without plastic contact [N/mm]."""
        return math.pi * self.radius * self.hardness**2 / self.e_star

    @property
    def is_plastic(self) -> bool:
        """True if the largest pressure equals the hardness."""
        return self.load > self.elastic_load

    @cached_property
    def _rest(self):
        """1 - (c/a)^2, and the elliptic integrals K and E of (c/a)^2."""
        if not self.is_plastic:
            return 1.0, math.pi / 2, math.pi / 2

        def missing(log_rest):
            rest = math.exp(log_rest)
            k = ellipkm1(rest)
            return self.load - self.elastic_load * k * (ellipe(1 - rest) - rest * k / 2) * 8 / math.pi**2

        if missing(_LEAST_LOG) > 0:
            raise InputError(f"load {format_exact(self.load)}: too large for this hardness")
        rest = math.exp(_root(missing, _LEAST_LOG, 0.0))
        return rest, float(ellipkm1(rest)), float(ellipe(1 - rest))

    @property
    def a(self) -> float:
        """Half-width of the contact [mm]."""
        if not self.is_plastic:
            return math.sqrt(4 * self.load * self.radius / (math.pi * self.e_star))
        return 4 * self.radius * self._rest[1] * self.hardness / (math.pi * self.e_star)

    @property
    def c(self) -> float:
        """Half-width of the plastic contact [mm]."""
        return self.a * math.sqrt(1 - self._rest[0])

    @property
    def max_pressure(self) -> float:
        """Pressure on the middle line [N/mm2]."""
        return self.hardness if self.is_plastic else 2 * self.load / (math.pi * self.a)

    @property
    def max_plastic_depth(self) -> float:
        """Plastic depth on the middle line [mm]."""
        return float(self.plastic_depth(0.0))

    @property
    def plastic_volume(self) -> float:
        """Integral of the plastic depth per length [mm2]."""
        rest, k, e = self._rest
        return self.a**3 / (3 * self.radius) * ((2 + 2 * rest) * e - 3 * e**2 / k - rest * k)

    def pressure(self, x: ArrayLike) -> Floats:
        """Return the contact pressure p at points [N/mm2]."""
        rest, k, e = self._rest
        x2, a = np.asarray(x, float) ** 2, self.a
        if not self.is_plastic:
            return self.max_pressure * np.sqrt(np.maximum(1 - x2 / a**2, 0))
        angle = _elastic_angle(x2, self.c**2, a**2)
        p = (
            a
            * self.e_star
            / (2 * self.radius)
            * (ellipeinc(angle, rest) - (1 - e / k) * ellipkinc(angle, rest))
        )
        return np.where(x2 <= self.c**2, self.hardness, p)

    def plastic_depth(self, x: ArrayLike) -> Floats:
        """Return the plastic depth w at points [mm]."""
        if not self.is_plastic:
            return np.zeros_like(x, float)
        # w' = -a / R times Jacobi's zeta function of sin(angle) = x/c
        rest, k, e = self._rest
        share = math.sqrt(1 - rest)
        sine = np.minimum(np.abs(np.asarray(x, float)) / self.c, 1)
        cosine, angle = np.sqrt((1 - sine) * (1 + sine)), np.arcsin(sine)
        zeta = ellipeinc(angle, 1 - rest) - e / k * ellipkinc(angle, 1 - rest)
        log = np.arcsinh(share * cosine / math.sqrt(rest)) / share
        half = (cosine * np.sqrt(rest + (share * cosine) ** 2) + rest * log) / 2
        return self.a * self.c / self.radius * np.where(sine < 1, e / k * log - half - zeta * sine, 0)


@dataclass(frozen=True)
class CappedWestergaard(Westergaard):
    """Westergaard's waves with a `hardness` H [N/mm2].

    H is at least the mean pressure. If p is replaced by H - p, and summits are exchanged with hollows, the gap becomes
    the plastic depth (`mirrored`). So the solution of full contact with plastic summits is Westergaard's, too. If H < 2
    p*, there are open, elastic and plastic parts at mean pressures from H^2 / (4 p*) to H - H^2 / (4 p*).
    """

    hardness: float = math.inf

    def __post_init__(self):
        super().__post_init__()
        require_hardness(self.hardness)
        if self.mean_pressure > self.hardness:
            raise InputError(
                f"mean_pressure {format_exact(self.mean_pressure)}: must be at most "
                f"the hardness {format_exact(self.hardness)}"
            )

    @property
    def mirrored(self) -> "CappedWestergaard":
        """Contact with the pressure H - p, shifted by half a wavelength."""
        return CappedWestergaard(
            self.amplitude, self.wavelength, self.e_star, self.hardness - self.mean_pressure, self.hardness
        )

    @property
    def _elastic(self):
        """Westergaard's elastic contact: the same waves without a hardness."""
        return Westergaard(self.amplitude, self.wavelength, self.e_star, self.mean_pressure)

    @property
    def is_plastic(self) -> bool:
        """True if the largest pressure equals the hardness."""
        return self.hardness < self._elastic.max_pressure

    @property
    def is_full(self) -> bool:
        """True if the bodies touch everywhere."""
        return not self.mirrored.is_plastic if self.is_plastic else super().is_full

    @cached_property
    def _edges(self):
        """Open, elastic and plastic parts of the wave under this mean pressure."""
        target, share = self.hardness / self.full_contact_at, self.mean_pressure / self.full_contact_at

        def parts(c2):
            # The upper end, a = 1, is full contact.
            log_rest = _root(lambda log: _Parts(c2, log).hardness - target, _LEAST_LOG, math.log1p(-c2))
            return _Parts(c2, log_rest)

        def excess(c2):
            found = parts(c2)
            return found.mean_pressure * min(target / found.hardness, 1) - share

        found = parts(_root(excess, 1e-24, 1 - target**2 / 4))
        if found.hardness > 1.001 * target:
            raise InputError(f"hardness {format_exact(self.hardness)}: too small for this mean pressure")
        return found

    @property
    def half_width(self) -> float:
        """Half-width of a contact strip [mm]."""
        if not self.is_plastic:
            return super().half_width
        return self.wavelength / math.pi * math.asin(1.0 if self.is_full else math.sqrt(self._edges.a2))

    @property
    def plastic_half_width(self) -> float:
        """Half-width of plastic contact [mm]."""
        if not self.is_plastic:
            return 0.0
        if self.is_full:
            return self.wavelength / 2 - self.mirrored.half_width
        return self.wavelength / math.pi * math.asin(math.sqrt(self._edges.c2))

    @property
    def plastic_fraction(self) -> float:
        """Share of the surface in plastic contact."""
        return 2 * self.plastic_half_width / self.wavelength

    @property
    def mean_gap(self) -> float:
        """Mean of the nonnegative gap [mm]."""
        return self.mirrored.mean_plastic_depth if self.is_plastic else super().mean_gap

    @property
    def mean_plastic_depth(self) -> float:
        """Mean of the plastic depth over a period [mm]."""
        if not self.is_plastic:
            return 0.0
        if self.is_full:
            return self.mirrored.mean_gap
        return float(self.amplitude * self._edges.moment(lambda t: t**2 / math.pi))

    @property
    def approach(self) -> float:
        """Approach [mm], with displacements relative to their mean.

        If p = H everywhere, the smallest possible approach is returned.
        """
        return self.amplitude - self.mean_gap + self.mean_plastic_depth

    @property
    def max_plastic_depth(self) -> float:
        """Plastic depth at the summits [mm]."""
        return float(self.plastic_depth(0.0, 0.0))

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the contact pressure p at points [N/mm2]."""
        if not self.is_plastic:
            return super().pressure(x, y)
        if self.is_full:
            return self.hardness - self.mirrored.pressure(np.asarray(x) + self.wavelength / 2, y)
        sine = self._sine(x, y)
        plastic = sine**2 <= self._edges.c2
        return np.where(plastic, self.hardness, self.full_contact_at * self._edges.pressure(sine))

    def plastic_depth(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the plastic depth w at points [mm]."""
        if not self.is_plastic:
            return np.zeros(np.broadcast(x, y).shape)
        if self.is_full:
            return self.mirrored.gap(np.asarray(x) + self.wavelength / 2, y)
        return self.amplitude * self._edges.depth(self._sine(x, y))

    def gap(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the gap, at least 0, at points [mm]."""
        if not self.is_plastic:
            return super().gap(x, y)
        return self.mirrored.plastic_depth(np.asarray(x) + self.wavelength / 2, y)

    def displacement(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the displacement u of both surfaces, whose mean is 0 [mm]."""
        e = self.gap(x, y) - self.plastic_depth(x, y)
        return e - self.undeformed_distance(x, y) + self.approach

    def _sine(self, x, y):
        return np.abs(np.sin(np.pi / self.wavelength * np.broadcast_arrays(np.asarray(x, float), y)[0]))


class _Parts:
    """Open, elastic and plastic parts of a wave.

    Pressures are in units of p*, depths in units of the amplitude, and P in units of pi p* q with q = 2 pi / L. `a2`
    and `c2` are the squares of sin(pi x / L) at the edges of contact and of plastic contact; `open` is 1 - a2.

    Parameters
    ----------
    c2, log_rest : float
        c2, and the logarithm of 1 - c2 / a2.
    """

    def __init__(self, c2, log_rest):
        self.c2, self.rest, self.inner = c2, math.exp(log_rest), -math.expm1(log_rest)
        self.a2 = min(c2 / self.inner, 1.0)
        self.open = max(self.inner - c2, 0.0) / self.inner
        self.whole = float(ellipkm1(self.rest))
        self._constant = 0.0  # g
        v, w = self._plastic(0.0)
        sine2 = c2 * ellipj(v, self.inner)[0] ** 2
        w = w / np.sqrt(1 - sine2)
        self._constant = -(w @ self._polynomial(sine2)) / w.sum()

    def _polynomial(self, sine2):
        """Return the polynomial P of the module, in the unit given there."""
        return (1 + self.a2 + self.c2 - 2 * sine2) * sine2 + self._constant

    def _plastic(self, start):
        """Return integration nodes and weights from `start` to the plastic edge.

        The nodes are along the last axis, and dense at the edge c. They are values of v, where x = c sn(v).
        """
        width = math.sqrt(1 - self.c2)
        end = np.arcsinh((self.whole - np.asarray(start))[..., None] / width)
        v = end * _NODES
        return self.whole - width * np.sinh(v), end * _WEIGHTS * width * np.cosh(v)

    def _elastic(self, end):
        """Return nodes and weights of the quadrature of the elastic pressure up to `end`."""
        width = math.sqrt(self.open) or 1e-12
        end = np.arcsinh(np.asarray(end)[..., None] / width)
        v = end * _NODES
        sine, _, dn, _ = ellipj(width * np.sinh(v), self.rest)
        sine2 = self.a2 * dn**2
        root = np.sqrt(self.open + self.a2 * self.rest * sine**2)  # cos(pi x / L)
        weights = end * _WEIGHTS * width * np.cosh(v) / root * self._polynomial(sine2)
        return sine2, weights * 2 / math.sqrt(self.a2)

    @property
    def hardness(self):
        """Hardness over p*, the mean pressure of full contact."""
        return self._elastic(ellipkinc(math.pi / 2, self.rest))[1].sum()

    @property
    def mean_pressure(self) -> float:
        """Mean pressure divided by p*: the mean of x, weighted by dp."""
        sine2, weights = self._elastic(ellipkinc(math.pi / 2, self.rest))
        return 2 / math.pi * (weights @ np.arcsin(np.sqrt(np.minimum(sine2, 1))))

    def pressure(self, sine):
        """Return the pressure, divided by p*.

        `sine` is sin(pi x / L) at the points x, with the wavelength L.
        """
        angle = _elastic_angle(sine**2, self.c2, self.a2)
        return self._elastic(ellipkinc(angle, self.rest))[1].sum(axis=-1)

    def moment(self, factor, start=0.0):
        """Return a moment of the plastic depth's second derivative, from `start`.

        It is the integral of w'' times ``factor(pi x / L)`` to the plastic edge c, with the depth w and the wavelength
        L. The unit of the result is the amplitude; the unit of dx is L / pi.
        """
        v, weights = self._plastic(start)
        sine = math.sqrt(self.c2) * ellipj(v, self.inner)[0]
        weights = weights * 4 / math.sqrt(self.a2) * self._polynomial(sine**2) / np.sqrt(1 - sine**2)
        return (weights * factor(np.arcsin(sine))).sum(axis=-1)

    def depth(self, sine):
        """Return the plastic depth, divided by the amplitude.

        `sine` is sin(pi x / L) at the points x, with the wavelength L.
        """
        c = math.sqrt(self.c2)
        angle = np.arcsin(np.minimum(sine / c, 1))
        start, x = ellipkinc(angle, self.inner), np.arcsin(np.minimum(sine, c))[..., None]
        return np.maximum(self.moment(lambda t: t - x, np.minimum(start, self.whole)), 0)


def _root(function, low, high):
    """Return the root of an increasing function between `low` and `high`.

    If rounding hides the root, return one of the ends. The function may be NaN near `high`.
    """
    shrunk = np.finfo(float).eps
    while np.isnan(function(high)):
        high, shrunk = high + shrunk * (low - high), 2 * shrunk
    if function(high) <= 0:
        return high
    return low if function(low) >= 0 else brentq(function, low, high, xtol=1e-30, rtol=1e-14)


def _elastic_angle(x2, c2, a2):
    """Return the angle am(v) at which x = a dn(v).

    The angle is 0 at the contact edge a, and pi/2 at the plastic edge c.
    """
    return np.arctan2(np.sqrt(np.maximum(a2 - x2, 0)), np.sqrt(np.maximum(x2 - c2, 0)))
