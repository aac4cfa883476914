"""Creep of viscoelastic bodies: generalised Maxwell and Kelvin models.

The relaxation modulus of a generalised Maxwell (Wiechert) model is ``G(t) = 1 - sum g_i (1 - exp(-t/t_i))``, relative
to the instantaneous modulus. Its creep function is ``J(t) = 1 + sum J_i (1 - exp(-t/tau_i))``. The Laplace transforms
obey ``s G(s) s J(s) = 1``, so the -1/tau_i are the zeros of

    phi(s) = s G(s) = 1 - sum g_i / (1 + s t_i),

one between each two neighbouring poles and one between 0 and the pole nearest to it, and ``J_i = tau_i /
phi'(-1/tau_i)`` (Findley, Lai, Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976).
"""

from itertools import pairwise
from math import fsum
from typing import NamedTuple

import numpy as np

_BISECTIONS = 200  # at most; doubles are halved until nothing lies between them
_LEAST_MODULUS = 1e-14  # Smaller shares of the modulus are below the rounding error of the others.
_SAME_TIME = 1e-12  # Relative difference of relaxation times up to which they are equal.
_SHORT_STEP = 1e-3  # Duration of a step over tau below which Taylor series replace differences that cancel.
_SERIES = np.array([[1 / 2, -1 / 3, 1 / 8, -1 / 30], [1 / 2, -1 / 6, 1 / 24, -1 / 120]])  # before, after


class CreepFunction(NamedTuple):
    """Creep function ``J(t) = 1 + sum J_i (1 - exp(-t/tau_i))``, relative to the instantaneous compliance."""

    strengths: tuple  # J_i
    times: tuple  # tau_i [s]

    @classmethod
    def from_relaxation(cls, times, moduli):
        """Convert the relaxation times t_i [s] and moduli g_i, which sum to less than 1."""
        t, g = (np.array(values, float) for values in (times, moduli))
        order = np.argsort(t)
        t, g = (values[order[g[order] > _LEAST_MODULUS]] for values in (t, g))
        is_new = np.diff(t, prepend=0.0) > _SAME_TIME * t
        g, t = np.bincount(np.cumsum(is_new) - 1, g), t[is_new]
        rates = [0.0, *1 / t[::-1]]  # poles of phi(-rate), and 0, where phi is positive
        roots = [_zero(t, g, low, high) for low, high in pairwise(rates)]
        tau = 1 / np.array(roots)
        slope = [(g * t / (1 - rate * t) ** 2).sum() for rate in roots]
        return cls(tuple((tau / slope).tolist()), tuple(tau.tolist()))

    def at(self, time):
        """Return J at times [s] from 0."""
        strengths, times = np.array(self.strengths), np.array(self.times)
        return 1 - np.expm1(-np.asarray(time, float)[..., None] / times) @ strengths

    def mixed(self, share):
        """Return the creep function if only a share of the compliance creeps."""
        return CreepFunction(tuple(share * strength for strength in self.strengths), self.times)

    def step(self, duration):
        """Return the coefficients of a step in which the pressure changes linearly.

        With the internal pressures e_i, ``e_i' = (p - e_i) / tau_i``, the displacement is ``A (p + sum J_i e_i)``, and
        a step of a `duration` [s] changes them exactly to ``decay e_i + before p(t) + after p(t + duration)``. Return
        decay, before and after, each of shape (i,).
        """
        ratio = np.maximum(duration / np.array(self.times), np.finfo(float).tiny)
        decay, mean = np.exp(-ratio), -np.expm1(-ratio) / ratio
        series = _SERIES @ ratio ** np.arange(1, 5)[:, None]
        before, after = np.where(ratio < _SHORT_STEP, series, [mean - decay, 1 - mean])
        return decay, before, after


def _zero(t, g, low, high):
    """Return the zero of phi(-rate) between two rates, by bisection.

    The rest is 1 - sum g, which sums near 1 would lose to rounding.
    """
    rest = fsum([1.0, *-g])
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        # Between its poles phi falls from inf (or from 1 - sum g at rate 0) to -inf as the rate grows.
        positive = rest - (g * middle * t / (1 - middle * t)).sum() > 0
        low, high = (middle, high) if positive else (low, middle)
    return middle
