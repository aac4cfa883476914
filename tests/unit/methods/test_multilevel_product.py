"""Multilevel product against matrices."""

import numpy as np
import pytest

from app.halfspace.fft.multiplier import Layout
from app.halfspace.grid import repeats_in
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


SHAPES = {
    False: [(1, 1), (1, 3), (2, 2), (5, 7), (6, 8), (9, 4), (12, 13), (33, 70)],
    True: [(2, 2), (4, 2), (6, 8), (2, 30), (12, 64), (34, 70)],
    "x": [(3, 2), (5, 8), (33, 70)],
    "y": [(2, 3), (6, 7), (34, 71)],
}


@pytest.mark.parametrize("factors", [(2, 2), (2, 1), (1, 2)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("periodic", "shape"), [(periodic, shape) for periodic in SHAPES for shape in SHAPES[periodic]]
)
def test_product_is_stencil_plus_interpolation_from_the_coarse_grid(periodic, shape, dtype, factors):
    rng = np.random.default_rng(3)
    in_y, in_x = rng.random((2, 3))
    twice = np.array([1.0, 2.0, 2.0])  # stencils are given as of a sum over waves
    level = StencilLevel(np.outer(in_x * twice, in_y * twice), factors)
    operator = MultilevelOperator(shape, [level], Same, Layout(dtype=dtype), periodic=periodic)
    repeats = repeats_in(periodic)
    from_y, from_x = (interpolation(*each) for each in zip(shape, factors, repeats, strict=True))
    for rows in (np.ones(shape[0], bool), rng.random(shape[0]) < 0.5)[: 1 if repeats[0] else 2]:
        p = rng.standard_normal(shape) * rows[:, None]
        expected = near(shape[0], 2, in_y, repeats[0]) @ p @ near(shape[1], 2, in_x, repeats[1])
        expected += from_y @ (from_y.T @ p @ from_x) @ from_x.T
        product = np.where(rows[:, None], p, np.nan).astype(dtype)
        operator.apply(product, product, rows)
        np.testing.assert_allclose(product[rows], expected[rows], rtol=0, atol=40 * np.finfo(dtype).eps)
