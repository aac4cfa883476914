"""Trend of the residual between plastic cells."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.material import Material
from app.methods.free.residual_trend import ResidualTrend
from app.parallel.slabs import Slabs


def trend_of(r, contact):
    out = np.zeros(r.shape)
    trend = ResidualTrend(np.where(contact, r, 0.0), contact, Slabs(len(r)), None)
    trend.add(1.0, np.ones(r.shape, bool), out)
    return out


def scattered(shape, share, seed=1):
    return np.random.default_rng(seed).random(shape) < share


@pytest.mark.parametrize("shape", [(16, 16), (32, 64), (64, 64), (128, 112)])
def test_trend_of_a_constant_is_nearly_the_constant_where_contact_is_dense(shape):
    trend = trend_of(np.full(shape, 2.0), np.ones(shape, bool))
    assert (abs(trend - 2) <= 0.5).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (17, 5), (100, 130)])
def test_trend_is_within_the_range_of_the_residual(shape):
    r, contact = np.random.default_rng(3).random(shape), scattered(shape, 0.3)
    trend = trend_of(r, contact)
    assert (trend >= 0).all() and (trend <= 1).all()


def test_trend_is_linear_in_the_residual():
    contact, rng = scattered((50, 70), 0.1), np.random.default_rng(2)
    one, other = rng.normal(size=(2, 50, 70))
    sums = 2 * trend_of(one, contact) - trend_of(other, contact)
    np.testing.assert_allclose(trend_of(2 * one - other, contact), sums, rtol=0, atol=1e-6)


def test_no_contact_has_no_trend():
    assert not trend_of(np.ones((40, 40)), np.zeros((40, 40), bool)).any()


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("share", [0.02, 0.05, 0.2])
def test_trend_is_most_of_the_displacement_between_spots(share, size):
    """The displacement is that of the pressure on C that reduces the residual to zero. C has square spots."""
    n = 48
    matrix = dense_matrix(Grid(n, n, 1.0, 1.0), Material.from_contact_modulus(1.0).kernel)
    contact = np.kron(scattered((n // size, n // size), share), np.ones((size, size))) > 0
    cells, r = contact.ravel(), 1 + 0.5 * np.cos(np.pi * np.arange(n) / n)[:, None] * np.ones(n)
    u = (matrix[:, cells] @ np.linalg.solve(matrix[np.ix_(cells, cells)], r.ravel()[cells])).reshape(n, n)
    between = ~contact
    assert np.linalg.norm((u - trend_of(r, contact))[between]) <= 0.6 * np.linalg.norm(u[between])
