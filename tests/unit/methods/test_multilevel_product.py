"""Multilevel product against matrices."""

import numpy as np
import pytest

from app.halfspace.fft.multiplier import Layout
from app.methods.multilevel_product import MultilevelOperator
from app.methods.symbol import StencilLevel


class Same:
    """M_H = 1."""

    def __init__(self, shape, layout):
        self.periods, self.flops, self.points = shape, 0, 0

    def apply(self, p, out):
        out[...] = p


def interpolation(n, factor, periodic=False):
    """Return the matrix of linear interpolation between cell centres."""
    if factor == 1:
        return np.eye(n)
    if periodic:
        matrix = np.zeros((n, n // 2))
        for i in range(n):
            matrix[i, i // 2] += 0.75
            matrix[i, (i // 2 + (1 if i % 2 else -1)) % (n // 2)] += 0.25
        return matrix
    matrix = np.zeros((n, n // 2 + 2))
    for i in range(n):
        matrix[i, i // 2 + 1] = 0.75
        matrix[i, i // 2 + 2 if i % 2 else i // 2] = 0.25
    return matrix


def near(n, reach, weights, periodic=False):
    """Return the matrix of a stencil along a direction."""
    if periodic:
        return sum(weights[abs(k)] * np.roll(np.eye(n), k, axis=0) for k in range(-reach, reach + 1))
    return sum(weights[abs(k)] * np.eye(n, k=k) for k in range(-reach, reach + 1))


@pytest.mark.parametrize("factors", [(2, 2), (2, 1), (1, 2)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1), (1, 3), (2, 2), (5, 7), (6, 8), (9, 4), (12, 13), (33, 70)])
def test_product_is_stencil_plus_interpolation_from_the_coarse_grid(shape, dtype, factors):
    rng = np.random.default_rng(3)
    in_y, in_x = rng.random((2, 3))
    twice = np.array([1.0, 2.0, 2.0])  # stencils are given as of a sum over waves
    level = StencilLevel(np.outer(in_x * twice, in_y * twice), factors)
    operator = MultilevelOperator(shape, [level], Same, Layout(dtype=dtype))
    from_y, from_x = map(interpolation, shape, factors)
    for wanted in (np.ones(shape[0], bool), rng.random(shape[0]) < 0.5):
        p = rng.standard_normal(shape) * wanted[:, None]
        expected = near(shape[0], 2, in_y) @ p @ near(shape[1], 2, in_x)
        expected += from_y @ (from_y.T @ p @ from_x) @ from_x.T
        given = np.where(wanted[:, None], p, np.nan).astype(dtype)
        operator.apply(given, given, wanted)
        np.testing.assert_allclose(given[wanted], expected[wanted], rtol=0, atol=20 * np.finfo(dtype).eps)


@pytest.mark.parametrize("factors", [(2, 2), (2, 1), (1, 2)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(2, 2), (4, 2), (6, 8), (2, 30), (12, 64), (34, 70)])
def test_periodic_product_is_stencil_plus_interpolation_from_the_coarse_grid(shape, dtype, factors):
    rng = np.random.default_rng(4)
    in_y, in_x = rng.random((2, 3))
    twice = np.array([1.0, 2.0, 2.0])
    level = StencilLevel(np.outer(in_x * twice, in_y * twice), factors)
    operator = MultilevelOperator(shape, [level], Same, Layout(dtype=dtype), periodic=True)
    (from_y, from_x), (ny, nx) = (
        (interpolation(*pair, periodic=True) for pair in zip(shape, factors, strict=True)),
        shape,
    )
    p, out = rng.standard_normal(shape), np.empty(shape, dtype)
    expected = near(ny, 2, in_y, periodic=True) @ p @ near(nx, 2, in_x, periodic=True)
    expected += from_y @ (from_y.T @ p @ from_x) @ from_x.T
    operator.apply(p.astype(dtype), out)
    np.testing.assert_allclose(out, expected, rtol=0, atol=40 * np.finfo(dtype).eps)
