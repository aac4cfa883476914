"""Stress of cells and strips on a layer, by tables in the distance.

Lengths are in thicknesses t of the layer. With the stress function a(q) of `app.halfspace.layer_waves` at a depth, the
stress below a pressure on cells follows from radial functions,

    g(r) = 1 / (2 pi r) int a(q) J1(q r) dq,      h(r), the same with a'',
    v(r) = -1 / (2 pi) int a'(q) J0(q r) dq,

because the stresses are derivatives of potentials. By Gauss's theorem, the stress of a cell is an integral along its
edges: of g and h, times the distance from the line of the edge or, for s_xy, along it; and of v. In the layer, the
function of a half-space of the layer's material, which has a closed form, is subtracted from a. So all functions are
smooth, over lengths of the *scale*: the depth in the base, and 2 - depth, the distance of the image of the surface, in
the layer.

An endless strip of pressure has the stresses of plane strain. They are the differences, between its two edges, of

    1 / pi int a''(q) sin(q x) / q dq,    -1 / pi int a(q) sin(q x) / q dq,    -1 / pi int a'(q) cos(q x) / q dq

for sigma_xx, sigma_zz and sigma_xz, at the distance x from an edge across the strip.

Cubic splines in asinh(r) interpolate the functions. The error of a stress is below 1e-8 of the largest pressure, or of
the largest stress if the layer is much stiffer than its base.
"""

from dataclasses import replace
from functools import lru_cache
from math import asinh, ceil, hypot, log2, sqrt

import numpy as np

from app.base.numba_cache import njit
from app.halfspace.hankel import HankelRule
from app.halfspace.layer_waves import LayerWaves

_SPACING = 0.02  # of the tables in asinh(r)
_MIN_RADIUS = 16.0  # of the tables
_MAX_STEP = 0.3  # panel of an edge over its distance from the singularities of the functions
_SHORT_STEP = 0.04  # panels below have two Gauss points instead of four
_NODES, _WEIGHTS = (np.concatenate([rule[k] for rule in map(np.polynomial.legendre.leggauss, (2, 4))])
                    for k in (0, 1))  # fmt: skip


@lru_cache(maxsize=4)
def _waves(layer, radius):
    """Return asinh of the radii, the Hankel rule, near and far waves."""
    reach = asinh(radius)
    v = np.linspace(0.0, reach, ceil(reach / _SPACING) + 1)
    rule, unit = HankelRule(np.sinh(v)), replace(layer, thickness=1.0)
    return v, rule, [LayerWaves(unit, q) for q in (rule.near, rule.far)]


@lru_cache(maxsize=256)
def _table(layer, depth, radius):
    """Return spline coefficients, shape (intervals, 3 functions, 4), and the scale.

    The functions of the distance r are g, h and v of the module, each multiplied by r^2 + scale^2. The depth is in
    thicknesses.
    """
    v, rule, waves = _waves(layer, radius)
    near, far = (wave.functions(depth, reflected=True) for wave in waves)
    g, slope, h = (rule.transform(near[k], far[k], kind) for k, kind in enumerate(("J1", "J0", "J1")))
    scale = _scale(depth)
    splines = _splines(v, np.stack([g, h, -slope]) / (2 * np.pi) * (np.sinh(v) ** 2 + scale**2))
    return np.ascontiguousarray(splines.c.transpose(1, 2, 0)), scale


@lru_cache(maxsize=256)
def _strip_table(layer, depth, radius):
    """Return splines of the functions of a strip's edge, and the scale.

    The first two functions of the distance x are divided by x, and all are multiplied by sqrt(x^2 + scale^2).
    """
    v, rule, waves = _waves(layer, radius)
    near, far = (wave.functions(depth, reflected=True) for wave in waves)
    xx, zz = (rule.transform(near[k], far[k], "sin") for k in (2, 0))
    xz = rule.transform(near[1] / rule.near, far[1] / rule.far, "cos")
    scale = _scale(depth)
    return _splines(v, np.stack([xx, -zz, -xz]) / np.pi * np.hypot(np.sinh(v), scale)), scale


def _scale(depth):
    return 2 - depth if depth <= 1 else depth


def _splines(v, functions):
    from scipy.interpolate import CubicSpline

    return CubicSpline(v, functions, axis=1, bc_type=("clamped", "not-a-knot"))


def _in_thicknesses(layer, depth, farthest):
    """Return a depth and the radius of tables up to a distance, in thicknesses."""
    t = layer.thickness
    radius = 2.0 ** ceil(log2(max(1.01 * farthest / t, _MIN_RADIUS)))
    return 1.0 if depth == t else depth / t, radius


def add_layer_corners(layer, x, y, depth, out):
    """Add the stress due to cell corners to `out`.

    The sum over the four corners of a cell, with alternating signs, is the stress of the cell. `x` and `y` are offsets
    of a point from the corners [mm], monotonic arrays. The depth is in mm. `out` has the shape (6, y.size, x.size).
    """
    depth, radius = _in_thicknesses(layer, depth, hypot(np.abs(x).max(), np.abs(y).max()))
    x, y = x / layer.thickness, y / layer.thickness
    coefficients, scale = _table(layer, depth, radius)
    spacing = asinh(radius) / len(coefficients)
    nu = layer.poisson[int(depth > 1)]
    _add_corners(x, y, coefficients, spacing, scale, nu, _NODES, _WEIGHTS, np.zeros((3, x.size)), out)


def strip_edges(layer, x, depth):
    """Return stresses xx, zz and xz due to the edges of strips, (3, x.size).

    The difference between the two edges of a strip is its stress. `x` are offsets of a point from the edges [mm]. The
    depth is in mm. In the layer the stresses of a half-space of its material must be added.
    """
    depth, radius = _in_thicknesses(layer, depth, np.abs(x).max())
    x = x / layer.thickness
    splines, scale = _strip_table(layer, depth, radius)
    edges = splines(np.arcsinh(np.abs(x))) / np.hypot(x, scale)
    edges[:2] *= x
    return edges


@njit()
def _cubic(c, v):
    return ((c[0] * v + c[1]) * v + c[2]) * v + c[3]


@njit()
def _integrate(line, start, end, coefficients, spacing, scale, nodes, weights):
    """Return integrals along an edge from `start` to `end`.

    The integrands are g, h and v (see the module), and g and h times the position. The edge is at the distance `line`
    from the origin.
    """
    sum_g, sum_h, sum_v, along_g, along_h = 0.0, 0.0, 0.0, 0.0, 0.0
    position, direction = start, 1.0 if end > start else -1.0
    while direction * (end - position) > 0.0:
        distance = sqrt(line * line + position * position + scale * scale)
        left = abs(end - position)
        step = min(left, _MAX_STEP * distance)
        first, count = (0, 2) if step < _SHORT_STEP * distance else (2, 4)
        half = direction * step / 2
        for m in range(first, first + count):
            at = position + half * (1 + nodes[m])
            squared = line * line + at * at
            v = asinh(sqrt(squared))
            k = min(int(v / spacing), len(coefficients) - 1)
            v -= k * spacing
            weight = half * weights[m] / (squared + scale * scale)
            g, h = weight * _cubic(coefficients[k, 0], v), weight * _cubic(coefficients[k, 1], v)
            sum_g, sum_h, sum_v = sum_g + g, sum_h + h, sum_v + weight * _cubic(coefficients[k, 2], v)
            along_g, along_h = along_g + at * g, along_h + at * h
        position = end if step == left else position + direction * step
    return sum_g, sum_h, sum_v, along_g, along_h


@njit()
def _add_corners(x, y, coefficients, spacing, scale, nu, nodes, weights, along_y, out):
    """Add the stress due to corners of rectangles at (x, y) to `out`; `along_y` is work space."""
    for j in range(y.size):
        y_before, x_before = y[j - 1] if j else 0.0, 0.0
        x_g, x_h, x_v, x_xy = 0.0, 0.0, 0.0, 0.0
        for i in range(x.size):
            g, h, v, _, _ = _integrate(x[i], y_before, y[j], coefficients, spacing, scale, nodes, weights)
            along_y[0, i] += x[i] * g
            along_y[1, i] += x[i] * h
            along_y[2, i] += v
            edge = y[j], x_before, x[i]
            g, h, v, along_g, along_h = _integrate(*edge, coefficients, spacing, scale, nodes, weights)
            x_g, x_h, x_v = x_g + y[j] * g, x_h + y[j] * h, x_v + v
            x_xy, x_before = x_xy + (1 - nu) * along_h + nu * along_g, x[i]
            out[0, j, i] += along_y[1, i] + nu * (x_h - x_g)
            out[1, j, i] += x_h + nu * (along_y[1, i] - along_y[0, i])
            out[2, j, i] -= along_y[0, i] + x_g
            out[3, j, i] += x_xy
            out[4, j, i] += along_y[2, i]
            out[5, j, i] += x_v
