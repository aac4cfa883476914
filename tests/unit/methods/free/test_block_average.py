"""Block means of the residual and their transpose."""

import numpy as np
import pytest
from operators import STENCIL

from app.methods.free.block_average import CONTACT_SHARE_OFFSET, SMOOTHING_PASSES, BlockAverage
from app.methods.free.contact_edge import EdgeExtension

SHAPES = [(1, 1), (1, 11), (7, 3), (12, 12), (17, 26)]
each_shape = pytest.mark.parametrize("shape", SHAPES)
each_size = pytest.mark.parametrize("cells", [1, 2, 4, 16])


def contact_of(shape, share=0.3):
    return np.random.default_rng(3).random(shape) < share


def field(shape, dtype=float, seed=1):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def make_average(contact, cells, r):
    average = BlockAverage(contact.shape, None, None, cells)
    average.set_contact(contact, r)
    return average


def means(x, cells):
    filled = np.zeros([-(-n // cells) * cells for n in x.shape])
    filled[: x.shape[0], : x.shape[1]] = x
    return filled.reshape(len(filled) // cells, cells, -1, cells).mean((1, 3))


def smooth(blocks):
    for _ in range(2 * SMOOTHING_PASSES):
        around = np.pad(blocks, ((1, 1), (0, 0)))
        blocks = ((around[:-2] + 2 * around[1:-1] + around[2:]) / 4).T  # in y, and then in x
    return blocks


def size_of(*fields):
    return np.prod([np.linalg.norm(field) for field in fields]) + 1e-300


@each_shape
@each_size
@pytest.mark.parametrize("dtype", [float, np.float32])
def test_extension_is_the_mean_over_contact_around(shape, cells, dtype):
    """Means are in single precision for any r."""
    contact, r = contact_of(shape), field(shape, dtype)
    r *= contact
    result, average = np.full_like(r, np.nan), make_average(contact, cells, r)
    average.extend(r, result)
    blocks = smooth(means(r, cells)) / (smooth(means(contact, cells)) + CONTACT_SHARE_OFFSET)
    expected = np.kron(blocks, np.ones((cells, cells)))[: shape[0], : shape[1]]
    np.testing.assert_allclose(result, np.where(contact, r, expected), rtol=0, atol=1e-6)
    average.extend(r, r)
    np.testing.assert_array_equal(r, result)


@each_shape
@each_size
@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.7, 1.0])
def test_transpose_of_means_and_steps_is_that_of_one_operator(shape, cells, steps, share):
    """<E r, b> = <r, E^T b>."""
    contact = contact_of(shape, share)
    r, b = field(shape) * contact, field(shape, seed=2)
    average, extension = make_average(contact, cells, r), EdgeExtension(shape, None, None, steps)
    extension.set_stencil(STENCIL)
    extension.set_contact(contact)
    extension.include_all_rows()
    extended, restricted = r.copy(), b.copy()
    average.extend(extended, extended)
    extension.extend(extended)
    np.testing.assert_array_equal(extended[contact], r[contact])
    extension.restrict(restricted)
    product = average.apply_transpose(r, restricted)
    assert product == pytest.approx(
        np.vdot(r, restricted * contact), rel=0, abs=1e-5 * size_of(r, restricted)
    )
    size = np.linalg.norm(extended) * np.linalg.norm(b)
    assert np.vdot(extended, b) == pytest.approx(
        np.vdot(r, restricted * contact), rel=0, abs=1e-6 * size + 1e-300
    )


def test_constant_continues_between_contact_spots_and_decays_away():
    contact = np.zeros((256, 256), bool)
    contact[:128:8, :128:8] = True
    average, x = BlockAverage(contact.shape, None, None, 16), contact.astype(float)
    assert average.set_contact(contact, x)
    average.extend(x, x)
    share = 1 / 64
    np.testing.assert_allclose(
        x[40:88, 40:88][~contact[40:88, 40:88]], share / (share + CONTACT_SHARE_OFFSET), rtol=1e-6
    )
    assert (x[192:] == 0).all() and (x[:, 192:] == 0).all()


def test_contact_in_one_area_is_not_scattered():
    contact = np.zeros((512, 512), bool)
    contact[80:420, 60:440] = True
    assert not BlockAverage(contact.shape, None, None, 16).set_contact(contact, np.ones(contact.shape))


@each_size
def test_means_follow_a_reduced_residual(cells):
    shape = (17, 26)
    # Values of q outside contact do not count.
    contact, r, q = (contact_of(shape), field(shape), field(shape, seed=2))
    average, (expected, result) = make_average(contact, cells, r * contact), np.empty((2, *shape))
    less = (r - 0.3 * q) * contact
    average.subtract(0.3, average.local_means(q))
    average.extend(less, result)
    average.update(less)
    average.extend(less, expected)
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-6)
