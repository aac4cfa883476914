"""Stress waves in a layer and in its base.

A surface pressure exp(i q x) on a layer makes stresses that depend on depth by a stress function a(s) with s = q z. In
the plane of the wave, with primes for derivatives by s,

    sigma_zz = -a,    sigma_xz = -i a',    sigma_xx = a'',    sigma_yy = nu (a'' - a),
    2 G q u_z = (1 - nu) a''' - (2 - nu) a',    2 G q u_x = -i ((1 - nu) a'' + nu a).

In the base, a = (c0 + c1 q (z - t)) exp(-q (z - t)). In the layer, a is the sum of two such functions: of z, which
decays from the surface, and of t - z, which decays from the base. No exponential exceeds 1. For q t below 1 these
functions are nearly dependent, so a is computed from the values of a, a', a'' and a''' at the surface. Two conditions
at the surface (a = 1, a' = 0) and four at the interface (stresses and displacements are continuous) determine the six
coefficients; on a rigid base the displacements are 0.

References
----------
T.C. O'Sullivan, R.B. King, J. Tribology 110 (1988) 235-240. D.M. Burmister, J. Applied Physics 16 (1945) 89-94.
"""

from functools import partial

import numpy as np

_SMALL = 1.0  # q t below which the layer's functions are computed from values at the surface


class LayerWaves:
    """Response of a `Layer` and its base to pressure waves of amplitude 1.

    `q` is an array of wave numbers, at least 0 [1/mm].
    """

    def __init__(self, layer, q):
        self.layer, self._q = layer, np.asarray(q, dtype=float)
        self._x = self._q * layer.thickness
        self._thin = self._x < _SMALL
        # Of thin layers: a'' and a''' at the surface. Of others: the amplitudes (c0 - 1, c1 - 1, b0, b1), where a is
        # (c0 + c1 s) exp(-s) + (b0 + b1 (x - s)) exp(s - x).
        thin = self._x[self._thin]
        self._curvature = _solve(layer, partial(_from_surface, thin), thin.size)
        self._amplitudes = _amplitudes(layer, self._x[~self._thin])
        # Of the base: a and a' at the interface.
        self._base = self._layer_functions(layer.thickness)[:2]

    def functions(self, depth, reflected=False):
        """Return the stress function and two derivatives at a depth [mm].

        A depth equal to the thickness is in the layer. With `reflected` the functions of a half-space of the layer's
        material are subtracted in the layer.
        """
        if depth <= self.layer.thickness:
            return self._layer_functions(depth, reflected)[:3]
        if self.layer.on_rigid_base:
            raise ValueError("a rigid base has no stress")
        s = self._q * (depth - self.layer.thickness)
        value, slope = self._base
        return _decaying(value, value + slope, s, np.exp(-s))[:3]

    def _layer_functions(self, depth, reflected=False):
        functions = np.empty((4, *self._q.shape))
        thin, s = self._thin, self._q * depth
        functions[:, thin] = _from_surface(s[thin], *self._curvature)
        if reflected:
            functions[:, thin] -= _decaying(1.0, 1.0, s[thin], np.exp(-s[thin]))
        c0, c1, b0, b1 = self._amplitudes
        if not reflected:
            c0, c1 = c0 + 1, c1 + 1
        thick = ~thin
        down, up = s[thick], self._x[thick] - s[thick]
        down = _decaying(c0, c1, down, np.exp(-down))
        up = _decaying(b0, b1, up, np.exp(-up))
        functions[:, thick] = _combine(down, up)
        return functions


def _decaying(c0, c1, s, decay):
    """Return (c0 + c1 s) exp(-s) and three derivatives, given exp(-s)."""
    line = c1 * s
    return (
        (c0 + line) * decay,
        (c1 - c0 - line) * decay,
        (c0 - 2 * c1 + line) * decay,
        (3 * c1 - c0 - line) * decay,
    )


def _combine(down, up):
    """Add a function of depth and a function of height, with derivatives."""
    return [d - u if k % 2 else d + u for k, (d, u) in enumerate(zip(down, up, strict=True))]


def _from_surface(s, second, third):
    """Return the stress function a and three derivatives at depths s, from values at the surface.

    There a is 1 and its first derivative is 0; `second` and `third` are its next two derivatives.
    """
    sinh, cosh = np.sinh(s), np.cosh(s)
    f3, f2 = (s * cosh - sinh) / 2, s * sinh / 2  # f2 has the second derivative 1 at s = 0, f3 the third
    f1, f0, rise = (sinh + s * cosh) / 2, cosh + s * sinh / 2, (3 * sinh + s * cosh) / 2
    return (
        cosh - f2 + second * f2 + third * f3,
        -f3 + second * f1 + third * f2,
        -f2 + second * f0 + third * f1,
        -f1 + second * rise + third * f0,
    )


def _base_conditions(layer, functions):
    """Return two numbers that must vanish at the interface."""
    (nu1, nu2), mu = layer.poisson, layer.modulus_ratio
    a, a1, a2, a3 = functions
    own, cross = 2 * (1 - nu2), 1 - 2 * nu2
    return (
        (1 - nu1) * a3 - (2 - nu1) * a1 - mu * (own * a + cross * a1),
        (1 - nu1) * a2 + nu1 * a + mu * (cross * a + own * a1),
    )


def _solve(layer, functions, count):
    """Solve two linear equations; each unknown has `count` values."""
    zero, one = np.zeros(count), np.ones(count)
    f, g = _base_conditions(layer, functions(zero, zero))
    f0, g0 = (v - w for v, w in zip(_base_conditions(layer, functions(one, zero)), (f, g), strict=True))
    f1, g1 = (v - w for v, w in zip(_base_conditions(layer, functions(zero, one)), (f, g), strict=True))
    determinant = f0 * g1 - f1 * g0
    return (f1 * g - f * g1) / determinant, (f * g0 - f0 * g) / determinant


def _amplitudes(layer, x):
    """Return the four amplitudes of the stress function at x = q t: two of exp(-z), two of exp(z - x)."""
    decay = np.exp(-x)

    def reflected(b0, b1):  # from a = 1 and a' = 0 at the surface
        top = (b0 + b1 * x) * decay
        return -top, b1 * decay - 2 * top

    def functions(b0, b1):
        c0, c1 = reflected(b0, b1)
        down, up = _decaying(1 + c0, 1 + c1, x, decay), _decaying(b0, b1, 0.0, 1.0)
        return _combine(down, up)

    b0, b1 = _solve(layer, functions, x.size)
    return *reflected(b0, b1), b0, b1
