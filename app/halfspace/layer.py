"""Surface displacement of a layer bonded to a base.

The base, or substrate, is a half-space or rigid. A pressure wave of wave number q displaces the surface of a layer of
shear modulus G1, Poisson's ratio nu1 and thickness t by ``u_q = (1 - nu1) / (G1 q) S(q t) p_q`` [1]_. With
``mu = G1 / G2``, x = q t and ``th = exp(-2 x)``,

    S(x) = (1 + 4 x kappa th - lambda kappa th^2) / (1 - (lambda + kappa + 4 kappa x^2) th + lambda kappa th^2),
    lambda = 1 - 4 (1 - nu1) / (1 + mu (3 - 4 nu2)),    kappa = (mu - 1) / (mu + 3 - 4 nu1).

S(x) is the displacement of the layered body divided by the displacement of a half-space of the layer's material. For
short waves S tends to 1, because they do not reach the substrate. For long waves S tends to mu (1 - nu2) / (1 - nu1),
the same ratio for a half-space of the substrate's material. On a rigid base, where mu = 0, S tends to 0. For small x,
the terms of the numerator nearly cancel, and so do the terms of the denominator, so both are rewritten.

References
----------
.. [1] T.C. O'Sullivan, R.B. King, Sliding contact stress field due to a spherical indenter on a layered elastic
   half-space, J. Tribology 110 (1988) 235-240.
"""

from dataclasses import dataclass

import numpy as np

_SMALL = 1.0  # x below which the rewritten form is used
_LARGEST = 350.0  # x above which th = 0
_TERMS = 11  # of the power series; the next term is below rounding for x up to 1


@dataclass(frozen=True)
class Layer:
    """Layer of thickness t on a half-space, or on a rigid base.

    Attributes
    ----------
    thickness : float
        Thickness t [mm].
    young, poisson : tuple of float
        Young's modulus [N/mm2] and Poisson's ratio of layer and substrate; an infinite modulus is a rigid base.
    """

    thickness: float
    young: tuple
    poisson: tuple

    @property
    def on_rigid_base(self):
        """True if the substrate is rigid."""
        return np.isinf(self.young[1])

    @property
    def modulus_ratio(self):
        """Shear modulus of the layer over the substrate's; 0 on a rigid base."""
        (young1, young2), (nu1, nu2) = self.young, self.poisson
        return (young1 / (1 + nu1)) / (young2 / (1 + nu2))

    @property
    def long_wave_ratio(self):
        """S(0), the limit of `ratio` for long waves; 0 on a rigid base."""
        return self.modulus_ratio * (1 - self.poisson[1]) / (1 - self.poisson[0])

    @property
    def plane_compliance(self):
        """(1 - nu1) / (2 pi G1) of the layer [mm2/N]."""
        return (1 - self.poisson[0] ** 2) / (np.pi * self.young[0])

    @property
    def confined_modulus(self):
        """Pressure over strain of a layer that cannot expand sideways [N/mm2]; infinite if incompressible."""
        nu, young = self.poisson[0], self.young[0]
        return young * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) if nu < 0.5 else np.inf

    @property
    def uniform_compliance(self):
        """Displacement by a uniform pressure 1 [mm / (N/mm2)].

        On a rigid base the displacement is the thickness over the confined modulus. On a half-space, whose
        displacement would be infinite, the number is 0.
        """
        return self.thickness / self.confined_modulus if self.on_rigid_base else 0.0

    def ratio(self, q):
        """Return `displacement_ratio` at wave numbers q above 0, an array [1/mm]."""
        x = np.asarray(q, dtype=float) * self.thickness
        return displacement_ratio(x, self.modulus_ratio, *self.poisson)


def displacement_ratio(x, mu, nu1, nu2):
    """Return S, a layered body's displacement over a half-space's.

    The half-space is of the layer's material. The ratio is S(x) of the module, for an array x of numbers q t above 0.
    """
    values, small = np.empty(x.shape), x < _SMALL
    values[small] = _ratio_of_long_waves(x[small], mu, nu1, nu2)
    values[~small] = _ratio_of_short_waves(np.minimum(x[~small], _LARGEST), mu, nu1, nu2)
    return values


def _ratio_of_short_waves(x, mu, nu1, nu2):
    a, b, th = 3 - 4 * nu1, 3 - 4 * nu2, np.exp(-2 * x)
    lam, kappa = 1 - (1 + a) / (1 + mu * b), (mu - 1) / (mu + a)
    both = lam * kappa * th**2
    return (1 + 4 * x * kappa * th - both) / (1 - (lam + kappa + 4 * kappa * x**2) * th + both)


def _ratio_of_long_waves(x, mu, nu1, nu2):
    """Return `displacement_ratio` for x below 1, without cancellation.

    The terms 1 - lambda, 1 - kappa, 1 + lambda and 1 - lambda kappa of the formula are computed as products.
    """
    a, b, th = 3 - 4 * nu1, 3 - 4 * nu2, np.exp(-2 * x)
    lam, kappa = 1 - (1 + a) / (1 + mu * b), (mu - 1) / (mu + a)
    without_lam, without_kappa = (1 + a) / (1 + mu * b), (1 + a) / (mu + a)
    with_lam = (2 * mu * b + 1 - a) / (1 + mu * b)
    without_both = mu * (1 + a) * (1 + b) / ((mu + a) * (1 + mu * b))
    odd, even = _series(x)
    top = without_both + 2 * kappa * th * (with_lam * np.sinh(2 * x) - odd)
    bottom = without_lam * without_kappa - np.expm1(-2 * x) * (lam * without_kappa + kappa * without_lam)
    return top / (bottom + 4 * kappa * th * (even - without_lam * np.sinh(x) ** 2))


def _series(x):
    """Return sinh(2x) - 2x and sinh(x)^2 - x^2 by their power series."""
    power, odd, even = 2 * x**2, np.zeros_like(x), np.zeros_like(x)  # (2x)^k / k!, k = 2
    for k in range(3, 3 + 2 * _TERMS, 2):
        power = power * (2 * x) / k
        odd += power
        power = power * (2 * x) / (k + 1)
        even += power / 2
    return odd, even
