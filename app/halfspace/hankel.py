"""Hankel, cosine and sine transforms of smooth functions at many distances.

The functions of the wave number q are smooth, and decay like exp(-q) or faster. Up to a distance of ten, the integrals
are Gauss sums over fixed wave numbers. At larger distances r they are sums over y = q r. There a smooth window cuts off
the integrand after some oscillations, because later ones cancel. So the same points y serve all distances.
"""

from math import log2

import numpy as np

_NEAR = 10.0  # distance up to which wave numbers do not depend on the distance
_Q_MAX = 38.0  # functions are below 1e-15 beyond
_PANEL = 0.4  # of wave numbers, short enough for oscillations at distance _NEAR
_Y_PANEL = 4.0
_Y_MIDDLE, _Y_WIDTH = 48.0, 9.5  # of the window's end
_FIRST_PANEL = 1e-8  # panels grow from here, because functions may vary at small wave numbers
_POINTS = 16  # Gauss points of a panel


class HankelRule:
    """Points and weights of transforms, at increasing `distances` from 0 on.

    The attributes `near` and `far` are the wave numbers at which a function is needed. `far` has a row for each
    distance above ten.
    """

    def __init__(self, distances):
        from scipy.special import erfc, j0, j1

        near = distances[distances <= _NEAR, None]
        self._distances = distances[distances > _NEAR]
        self.near, weights = _panels(_PANEL, _Q_MAX)
        over_distance = j1(self.near * near) / np.maximum(near, np.finfo(float).tiny)
        over_distance = np.where(near > 0, over_distance, self.near / 2)
        cosine, sine = np.cos(self.near * near), np.sinc(self.near * near / np.pi)
        self._near = [weights * wave for wave in (j0(self.near * near), over_distance, cosine, sine)]
        y, weights = _panels(_Y_PANEL, _Y_MIDDLE + 5 * _Y_WIDTH)
        weights *= erfc((y - _Y_MIDDLE) / _Y_WIDTH) / 2
        self._far = [weights * wave for wave in (j0(y), j1(y), np.cos(y), np.sin(y) / y)]
        self.far = y / self._distances[:, None]

    def transform(self, near, far, kind):
        """Return the transform of a function f at each distance r.

        The transform is the integral of f(q) w dq with w = J0(q r) if `kind` is "J0", J1(q r) / r if it is "J1",
        cos(q r) if it is "cos", and sin(q r) / (q r) if it is "sin". The arguments `near` and `far` are the values of f
        at the wave numbers in the attributes `near` and `far`.
        """
        k = ("J0", "J1", "cos", "sin").index(kind)
        beyond = far @ self._far[k] / self._distances ** (2 if kind == "J1" else 1)
        return np.concatenate([self._near[k] @ near, beyond])


def _panels(step, end):
    """Return points and weights of a composite Gauss rule from 0 to `end`."""
    growing = np.geomspace(_FIRST_PANEL, step, 2 + int(log2(step / _FIRST_PANEL)))
    edges = np.concatenate([[0.0], growing, np.arange(2 * step, end + step, step)])
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    return (half * nodes + middle).ravel(), (half * weights).ravel()
