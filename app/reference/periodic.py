"""Periodic contact of waves; full contact.

A pressure wave ``p_q exp(i q x)`` displaces the half-space by ``u_q = 2 p_q / (E* |q|)``. Displacements are counted
from their mean, so that mean(gap) = mean(undeformed distance) - approach. `mean_pressure` is the load over the area of
a period, not over the contact area.

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
from app.reference.base import require_positive
from app.reference.hertz import EllipticHertz


def full_contact_pressure(distance, dx, dy, e_star, mean_pressure=0.0):
    """Return the pressure that flattens a periodic surface.

    A wave h_q of the undeformed distance h needs the pressure wave ``p_q = -E* |q| h_q / 2``. `distance` holds h,
    shape (ny, nx), in points dx, dy apart over one period [mm]. The pressure solves the contact problem if it is
    positive everywhere. E* and pressures are in N/mm2.
    """
    ny, nx = distance.shape
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(ny, dy)[:, None], np.fft.rfftfreq(nx, dx))
    return mean_pressure - np.fft.irfft2(e_star / 2 * q * np.fft.rfft2(distance), s=distance.shape)


@dataclass(frozen=True)
class WavyContact(ABC):
    """Periodic contact of waves, with a summit at the origin.

    Parameters
    ----------
    amplitude, wavelength : float
        a and L [mm]: the undeformed distance is a (1 - wave), with a wave of period L that the subclass defines.
    e_star : float
        Contact modulus E* [N/mm2].
    mean_pressure : float
        Load over the area of a period [N/mm2]; no contact if not positive.
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
        """Return the wave: the height over the amplitude, 1 at summits."""

    @property
    @abstractmethod
    def full_contact_at(self):
        """Least mean pressure p* of full contact [N/mm2]."""

    @property
    def is_full(self):
        """True if the bodies touch everywhere."""
        return self.mean_pressure >= self.full_contact_at

    @property
    def _share(self):
        """Mean pressure over that of full contact, from 0 to 1."""
        return min(max(self.mean_pressure / self.full_contact_at, 0.0), 1.0)

    def undeformed_distance(self, x, y):
        """Return the undeformed distance at zero approach [mm]."""
        return self.amplitude * (1 - self._wave(x, y))

    def full_pressure(self, x, y):
        """Return the pressure that would hold full contact [N/mm2].

        Where it is negative the bodies would have to be pulled together.
        """
        return self.mean_pressure + self.full_contact_at * self._wave(x, y)


@dataclass(frozen=True)
class Westergaard(WavyContact):
    """Waves in x: distance ``a (1 - cos(2 pi x/L))``.

    Contact is at ``|x| < b``. With ``psi = pi x / L`` and ``s = sin(pi b / L)``, ``s^2`` is the mean pressure over the
    one of full contact, p*. Pressure p and gap e are::

        p = 2 p* cos(psi) sqrt(s^2 - sin(psi)^2)                                          in contact,
        e = 2 a (t sqrt(t^2 - s^2) - s^2 arcosh(t / s)), t = |sin(psi)|                    outside

    They belong to p* (i sin(2 psi) + 2 cos(psi) sqrt(s^2 - sin(psi)^2)), which is analytic in the half-space: p is its
    real part, e the integral over x of its imaginary part, up to a factor. The mean gap E follows from
    dE/ds = 4 a s log(s).
    """

    def _wave(self, x, y):
        return np.broadcast_arrays(np.cos(2 * np.pi * np.asarray(x) / self.wavelength), y)[0]

    @property
    def full_contact_at(self):
        """Mean pressure of full contact, pi E* a/L [N/mm2]."""
        return math.pi * self.e_star * self.amplitude / self.wavelength

    @property
    def half_width(self):
        """Half-width b of a contact strip [mm]."""
        return self.wavelength / math.pi * math.asin(math.sqrt(self._share))

    @property
    def contact_fraction(self):
        """Share of the surface in contact."""
        return 2 * self.half_width / self.wavelength

    @property
    def max_pressure(self):
        """Pressure at the summits [N/mm2]."""
        return float(self.pressure(0.0, 0.0))

    @property
    def mean_gap(self):
        """Mean distance of the deformed surfaces [mm]."""
        share = self._share
        return self.amplitude * (1 - share + share * math.log(share)) if share else self.amplitude

    @property
    def approach(self):
        """Approach [mm] if displacements have mean 0; 0 without contact."""
        return self.amplitude - self.mean_gap

    def _sines(self, x, y):
        """Return |sin(psi)|, cos(psi)^2, and sin(psi)^2 - s^2.

        psi is pi x / L, and s is |sin(psi)| at the contact edge; the last number is positive outside of contact.
        """
        psi = np.pi / self.wavelength * np.broadcast_arrays(np.asarray(x, float), y)[0]
        rim = math.pi / self.wavelength * self.half_width
        return np.abs(np.sin(psi)), np.cos(psi) ** 2, np.sin(psi - rim) * np.sin(psi + rim)

    def pressure(self, x, y):
        """Return the contact pressure p at points [N/mm2]."""
        if self.is_full:
            return self.full_pressure(x, y)
        _, cosine2, outside = self._sines(x, y)
        return 2 * self.full_contact_at * np.sqrt(cosine2 * np.maximum(-outside, 0))

    def gap(self, x, y):
        """Return the gap e [mm]; zero in contact."""
        t, _, outside = self._sines(x, y)
        if self.is_full:
            return np.zeros_like(t)
        if not self._share:
            return self.undeformed_distance(x, y)
        s, root = math.sqrt(self._share), np.sqrt(np.maximum(outside, 0))
        return 2 * self.amplitude * (t * root - s**2 * np.arcsinh(root / s))

    def displacement(self, x, y):
        """Return the displacement u of both surfaces, whose mean is 0 [mm]."""
        return self.gap(x, y) - self.undeformed_distance(x, y) + self.approach


@dataclass(frozen=True)
class Bisinusoidal(WavyContact):
    """Waves in x and y: ``a (1 - cos(2 pi x/L) cos(2 pi y/L))``.

    There are two summits in each period L x L. The solution of full contact is exact. Of partial contact only two
    limits are known in closed form: Hertz's contact on every summit for light loads, and a pressurised penny-shaped
    crack about every hollow near full contact.
    """

    def _wave(self, x, y):
        k = 2 * np.pi / self.wavelength
        return np.cos(k * np.asarray(x)) * np.cos(k * np.asarray(y))

    @property
    def full_contact_at(self):
        """Mean pressure p* of full contact, sqrt(2) pi E* a/L [N/mm2]."""
        return math.sqrt(2) * math.pi * self.e_star * self.amplitude / self.wavelength

    @cached_property
    def on_a_summit(self):
        """Hertz's contact of one summit (`EllipticHertz`), for light loads."""
        radius = self.wavelength**2 / (4 * math.pi**2 * self.amplitude)
        load = max(self.mean_pressure, 0.0) * self.wavelength**2 / 2
        return EllipticHertz.from_load(radius, radius, self.e_star, load)

    @property
    def light_contact_fraction(self):
        """Contact fraction for light loads, by Hertz's theory.

        It is pi (3 pbar / (8 pi p*))^(2/3), with the mean pressure pbar and that of full contact, p*.
        """
        return 2 * self.on_a_summit.contact_area / self.wavelength**2

    @property
    def hollow_radius(self):
        """Radius c of the gap about a hollow, near full contact [mm].

        Full contact at a mean pressure pbar below p* would need the tension p* - pbar - p* (2 pi r / L)^2 / 2 at a
        distance r from the hollow. It opens a crack without singularity at its edge if (2 pi c / L)^2 =
        3 (1 - pbar / p*).
        """
        return self.wavelength / (2 * math.pi) * math.sqrt(3 * (1 - self._share))

    @property
    def heavy_contact_fraction(self):
        """Contact fraction near full contact: 1 without the cracks about hollows.

        It is 1 - 3/(2 pi) (1 - pbar/p*), with the mean pressure pbar and that of full contact, p*.
        """
        return 1 - 2 * math.pi * (self.hollow_radius / self.wavelength) ** 2

    @property
    def heavy_mean_gap(self):
        """Mean gap near full contact [mm].

        The gap at a distance r from a hollow is (8 p* k^2 / (9 pi E*)) (c^2 - r^2)^(3/2), with k = 2 pi / L and c the
        `hollow_radius`.
        """
        k = 2 * math.pi / self.wavelength
        deepest = 8 * self.full_contact_at * k**2 / (9 * math.pi * self.e_star)
        return 2 * deepest * 2 * math.pi * self.hollow_radius**5 / 5 / self.wavelength**2
