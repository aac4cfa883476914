"""Periodic contact of waves, and full contact.

A pressure wave ``p_q exp(i q x)`` displaces the half-space by ``u_q = 2 p_q / (E* |q|)``. Displacements are relative to
their mean, so that mean(gap) = mean(undeformed distance at approach zero) - approach. `mean_pressure` is the load
divided by the area of a period, not by the contact area.

References
----------
H.M. Westergaard, Bearing pressures and cracks, J. Appl. Mech. 6 (1939) A49. K. L. Johnson, Contact Mechanics, Cambridge
1985, Sec. 13.2. K.L. Johnson, J.A. Greenwood, J.G. Higginson, The contact of elastic regular wavy surfaces,
Int. J. Mech. Sci. 27 (1985) 383.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.base.errors import InputError, format_exact
from app.base.types import ArrayLike, Floats
from app.reference.base import require_positive
from app.reference.hertz import EllipticHertz


def full_contact_pressure(
    distance: ArrayLike, dx: float, dy: float, e_star: float, mean_pressure: float = 0.0
) -> Floats:
    """Return the pressure that flattens a periodic surface [N/mm2].

    A wave h_q of the undeformed distance h needs the pressure wave ``p_q = -E* |q| h_q / 2``. `distance` is h, shape
    (ny, nx), at points that are dx, dy apart over one period [mm]. If the pressure is positive everywhere, it solves
    the contact problem. E* and `mean_pressure` are in N/mm2.
    """
    ny, nx = distance.shape
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(ny, dy)[:, None], np.fft.rfftfreq(nx, dx))
    return mean_pressure - np.fft.irfft2(e_star / 2 * q * np.fft.rfft2(distance), s=distance.shape)


@dataclass(frozen=True)
class WavyContact(ABC):
    """Periodic contact of waves, summit at the origin.

    Parameters
    ----------
    amplitude, wavelength : float
        a and L [mm]: the undeformed distance is a (1 - wave), with a wave of period L that the subclass defines.
    e_star : float
        Contact modulus E* [N/mm2].
    mean_pressure : float
        Load divided by the area of a period [N/mm2]. There is no contact unless it is positive.
    """

    amplitude: float
    wavelength: float
    e_star: float
    mean_pressure: float

    def __post_init__(self):
        require_positive(amplitude=self.amplitude, wavelength=self.wavelength, e_star=self.e_star)
        if not math.isfinite(self.mean_pressure):
            raise InputError(f"mean_pressure {format_exact(self.mean_pressure)}: must be finite")

    @abstractmethod
    def _wave(self, x, y):
        """Return the height divided by amplitude, 1 at summits."""

    @property
    @abstractmethod
    def full_contact_at(self) -> float:
        """Mean pressure p* at which full contact begins [N/mm2]."""

    @property
    def is_full(self) -> bool:
        """True if the bodies touch everywhere."""
        return self.mean_pressure >= self.full_contact_at

    @property
    def _share(self):
        """Mean pressure divided by the full-contact pressure p*, from 0 to 1."""
        return min(max(self.mean_pressure / self.full_contact_at, 0.0), 1.0)

    def undeformed_distance(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the undeformed distance at zero approach [mm]."""
        return self.amplitude * (1 - self._wave(x, y))

    def full_pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the pressure that would keep full contact [N/mm2].

        Where it is negative, full contact would need tension.
        """
        return self.mean_pressure + self.full_contact_at * self._wave(x, y)


@dataclass(frozen=True)
class Westergaard(WavyContact):
    """Waves in x: ``a (1 - cos(2 pi x/L))``.

    Contact is at ``|x| < b``. Let ``psi = pi x / L`` and ``s = sin(pi b / L)``. Then ``s^2`` is the mean pressure
    divided by p*, the mean pressure of full contact. Pressure p and gap e are::

        p = 2 p* cos(psi) sqrt(s^2 - sin(psi)^2)                                          in contact,
        e = 2 a (t sqrt(t^2 - s^2) - s^2 arcosh(t / s)), t = |sin(psi)|                    outside

    Both follow from p* (i sin(2 psi) + 2 cos(psi) sqrt(s^2 - sin(psi)^2)), which is analytic in the half-space: p is
    the real part, and e is the integral over x of the imaginary part, up to a factor. The mean gap E follows from dE/ds
    = 4 a s log(s).
    """

    def _wave(self, x, y):
        return np.broadcast_arrays(np.cos(2 * np.pi * np.asarray(x) / self.wavelength), y)[0]

    @property
    def full_contact_at(self) -> float:
        """Mean pressure of full contact, pi E* a/L [N/mm2]."""
        return math.pi * self.e_star * self.amplitude / self.wavelength

    @property
    def half_width(self) -> float:
        """Half-width b of a contact strip [mm]."""
        return self.wavelength / math.pi * math.asin(math.sqrt(self._share))

    @property
    def contact_fraction(self) -> float:
        """Share of the surface in contact."""
        return 2 * self.half_width / self.wavelength

    @property
    def max_pressure(self) -> float:
        """Pressure at the summits [N/mm2]."""
        return float(self.pressure(0.0, 0.0))

    @property
    def mean_gap(self) -> float:
        """Mean of the gap [mm]."""
        share = self._share
        return self.amplitude * (1 - share + share * math.log(share)) if share else self.amplitude

    @property
    def approach(self) -> float:
        """Approach [mm], with displacements relative to their mean.

        The approach is 0 without contact.
        """
        return self.amplitude - self.mean_gap

    def _sines(self, x, y):
        """Return |sin(psi)|, cos(psi)^2, and sin(psi)^2 - s^2.

        psi is pi x / wavelength, and s is |sin(psi)| at the contact edge. The last number is positive outside contact.
        """
        psi = np.pi / self.wavelength * np.broadcast_arrays(np.asarray(x, float), y)[0]
        rim = math.pi / self.wavelength * self.half_width
        return np.abs(np.sin(psi)), np.cos(psi) ** 2, np.sin(psi - rim) * np.sin(psi + rim)

    def pressure(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the contact pressure p at points [N/mm2]."""
        if self.is_full:
            return self.full_pressure(x, y)
        _, cosine2, outside = self._sines(x, y)
        return 2 * self.full_contact_at * np.sqrt(cosine2 * np.maximum(-outside, 0))

    def gap(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the gap e [mm]; zero in contact."""
        t, _, outside = self._sines(x, y)
        if self.is_full:
            return np.zeros_like(t)
        if not self._share:
            return self.undeformed_distance(x, y)
        s, root = math.sqrt(self._share), np.sqrt(np.maximum(outside, 0))
        return 2 * self.amplitude * (t * root - s**2 * np.arcsinh(root / s))

    def displacement(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the displacement u of both surfaces, whose mean is 0 [mm]."""
        return self.gap(x, y) - self.undeformed_distance(x, y) + self.approach


@dataclass(frozen=True)
class Bisinusoidal(WavyContact):
    """Waves in x and y: ``a (1 - cos(2 pi x/L) cos(2 pi y/L))``.

    There are two summits in each period L x L. The solution of full contact is exact. For partial contact only two
    limits are known in closed form: for light loads, Hertz's contact on every summit; near full contact, a pressurised
    penny-shaped crack around every hollow.
    """

    def _wave(self, x, y):
        k = 2 * np.pi / self.wavelength
        return np.cos(k * np.asarray(x)) * np.cos(k * np.asarray(y))

    @property
    def full_contact_at(self) -> float:
        """Mean pressure p* of full contact, sqrt(2) pi E* a/L [N/mm2]."""
        return math.sqrt(2) * math.pi * self.e_star * self.amplitude / self.wavelength

    @cached_property
    def on_a_summit(self) -> EllipticHertz:
        """Contact of one summit for light loads, an `EllipticHertz`."""
        radius = self.wavelength**2 / (4 * math.pi**2 * self.amplitude)
        load = max(self.mean_pressure, 0.0) * self.wavelength**2 / 2
        return EllipticHertz.from_load(radius, radius, self.e_star, load)

    @property
    def light_contact_fraction(self) -> float:
        """Contact fraction for light loads, by Hertz's theory.

        The fraction is pi (3 pbar / (8 pi p*))^(2/3), where pbar is the mean pressure, and p* is pbar at full contact.
        """
        return 2 * self.on_a_summit.contact_area / self.wavelength**2

    @property
    def hollow_radius(self) -> float:
        """Radius c of the gap around a hollow, near full contact [mm].

        The mean pressure pbar is a little below p*, the mean pressure of full contact. L is the wavelength. The gap is
        like a round crack of radius c, which the tension p* - pbar - p* (2 pi r / L)^2 / 2 at a distance r from the
        hollow would close. The pressure at its edge is not singular, so (2 pi c / L)^2 = 3 (1 - pbar / p*).
        """
        return self.wavelength / (2 * math.pi) * math.sqrt(3 * (1 - self._share))

    @property
    def heavy_contact_fraction(self) -> float:
        """Contact fraction near full contact: 1 minus the area fraction of open hollows.

        The fraction is 1 - 3/(2 pi) (1 - pbar/p*), where pbar is the mean pressure, and p* is pbar at full contact.
        """
        return 1 - 2 * math.pi * (self.hollow_radius / self.wavelength) ** 2

    @property
    def heavy_mean_gap(self) -> float:
        """Mean gap near full contact [mm].

        The gap at a distance r from a hollow is (8 p* k^2 / (9 pi E*)) (c^2 - r^2)^(3/2), with k = 2 pi / L, the
        `hollow_radius` c, and the mean pressure p* of full contact.
        """
        k = 2 * math.pi / self.wavelength
        deepest = 8 * self.full_contact_at * k**2 / (9 * math.pi * self.e_star)
        return 2 * deepest * 2 * math.pi * self.hollow_radius**5 / 5 / self.wavelength**2
