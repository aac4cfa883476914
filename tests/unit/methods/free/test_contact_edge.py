"""Extension past the contact edge and its transpose, against their definition."""

import numpy as np
import pytest
from operators import STENCIL
from scipy.ndimage import binary_dilation, convolve

from app.halfspace.chebyshev import chebyshev_steps
from app.halfspace.grid import Grid, repeats_in
from app.halfspace.influence import dense_matrix
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.methods.free import contact_edge
from app.methods.free.circulant import circulant_inverse
from app.methods.free.contact_edge import EdgeExtension

SHAPES = [(1, 1), (1, 11), (11, 1), (2, 3), (3, 2), (8, 8), (17, 26)]
STEPS = [0, 1, 2, 3]
each_shape = pytest.mark.parametrize("shape", SHAPES)
each_number_of_steps = pytest.mark.parametrize("steps", STEPS)


def contact_sets(shape):
    """Yield contact sets: none, all, one cell, lines, random ones."""
    rng = np.random.default_rng(5)
    yield np.zeros(shape, bool)
    yield np.ones(shape, bool)
    for cell in ((0, 0), (-1, -1), (shape[0] // 2, shape[1] // 2)):
        one = np.zeros(shape, bool)
        one[cell] = True
        yield one
        yield ~one
    yield np.broadcast_to(np.arange(shape[0])[:, None] == shape[0] // 2, shape).copy()
    yield np.broadcast_to(np.arange(shape[1]) == shape[1] - 1, shape).copy()
    for density in (0.02, 0.1, 0.3, 0.7):
        yield rng.random(shape) < density


def make(contact, steps, stencil=STENCIL, periodic=False):
    extension = EdgeExtension(contact.shape, None, None, steps, periodic)
    extension.set_stencil(stencil)
    extension.set_contact(contact)
    return extension


def around(field, weights, periodic):
    """The stencil's sums, with zeros outside the patch or its continuation."""
    in_y, in_x = repeats_in(periodic)
    wide = np.pad(field, ((1, 1), (0, 0)), mode="wrap" if in_y else "constant")
    wide = np.pad(wide, ((0, 0), (1, 1)), mode="wrap" if in_x else "constant")
    return convolve(wide, weights, mode="constant")[1:-1, 1:-1]


@pytest.mark.parametrize("periodic", ["x", "y"])
@pytest.mark.parametrize("shape", [(6, 9), (1, 7), (8, 2)])
def test_extension_continues_across_the_sides_of_one_direction(shape, periodic):
    for contact in contact_sets(shape):
        extension, r = make(contact, 3, periodic=periodic), field(shape) * contact
        expected = r
        for length in lengths(3):
            expected = expected - length * ~contact * around(expected, np.array(STENCIL), periodic)
        np.testing.assert_allclose(apply(extension.extend, r), expected, rtol=0, atol=1e-14)


def extended(contact, steps, r, rim="constant"):
    """Return E r by its definition on the whole patch."""
    x = r * contact
    for length in lengths(steps):
        x = x - length * ~contact * convolve(x, np.array(STENCIL), mode=rim)
    return x


def lengths(steps):
    """Return Chebyshev's step lengths for the stencil."""
    waves = np.cos(np.arange(2) * np.pi)
    weights = np.array(STENCIL)
    results = [
        1 + 2 * weights[1, 0] * x + 2 * weights[0, 1] * y + 4 * weights[0, 0] * x * y
        for x in waves
        for y in waves
    ]
    return chebyshev_steps(steps, min(results), max(results))


def restricted(contact, steps, b, rim="constant"):
    """E^T b: the transposed sweeps."""
    for length in reversed(lengths(steps)):
        b = b - convolve(~contact * b * length, np.array(STENCIL), mode=rim)
    return b * contact


def field(shape, dtype=float, seed=1):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


def apply(operation, x):
    x = x.copy()
    operation(x)
    return x


@each_shape
@each_number_of_steps
@pytest.mark.parametrize(
    ("dtype", "atol", "rim"),
    [(np.float64, 1e-14, "constant"), (np.float32, 2e-6, "constant"), (np.float64, 1e-14, "wrap")],
)
def test_extension_and_transpose_are_those_of_the_definition(shape, steps, dtype, atol, rim):
    for contact in contact_sets(shape):
        extension, b = make(contact, steps, periodic=rim == "wrap"), field(shape, dtype)
        r = b * contact
        results = apply(extension.extend, r), apply(extension.restrict, b)
        next_to_contact = np.full_like(r, np.nan)
        extension.extend(r, next_to_contact)
        np.testing.assert_array_equal(next_to_contact, results[0])
        assert results[0].dtype == results[1].dtype == dtype
        np.testing.assert_allclose(results[0], extended(contact, steps, r, rim), rtol=0, atol=atol)
        np.testing.assert_allclose(
            results[1] * contact, restricted(contact, steps, b, rim), rtol=0, atol=atol
        )


def test_ranks_without_rows_read_no_memory(monkeypatch):
    """In Python, a read outside the array raises."""
    monkeypatch.setattr(contact_edge, "_all_steps", contact_edge._all_steps.py_func)
    extension = make(np.zeros((0, 5), bool), 3, periodic=True)
    extension.extend(np.zeros((0, 5)))
    extension.restrict(np.zeros((0, 5)))


@pytest.mark.parametrize(
    ("r", "off"),
    [
        (lambda x, y: 1 + 0 * x, 0.45),
        (lambda x, y: x, 0.3),
        (lambda x, y: np.cos(x / 3) * np.cos(y / 4), 0.3),
        (lambda x, y: field(x.shape), 0.3),
    ],
    ids=["constant", "linear", "smooth", "noise"],
)
def test_extended_residual_predicts_the_displacement_near_contact(r, off):
    """A solve adds A z to u, with A z = r on C and nearly E r next to C."""
    grid = Grid(32, 32, 1.0, 1.0)
    y, x = np.mgrid[:32, :32] - 15.5
    contact = x**2 + y**2 < 10**2
    matrix = dense_matrix(grid, UNIT)
    inside = contact.reshape(-1)
    r = r(x, y) * contact
    change = matrix[:, inside] @ np.linalg.solve(matrix[np.ix_(inside, inside)], r[contact])
    extension = make(contact, 2, circulant_inverse(InfluenceOperator(grid, UNIT)).centre)
    next_to_contact = binary_dilation(contact) & ~contact
    predicted = apply(extension.extend, r)[next_to_contact]
    change = change.reshape(contact.shape)[next_to_contact]
    assert np.linalg.norm(predicted - change) < off * np.linalg.norm(change)


def test_extension_follows_the_contact_set_whatever_the_unit_of_the_stencil():
    first, second = np.random.default_rng(3).random((2, 17, 26)) < 0.3
    extension = make(first, 3, stencil=2.5 * np.array(STENCIL))
    extension.set_contact(second)
    r = field(second.shape) * second
    np.testing.assert_allclose(apply(extension.extend, r), extended(second, 3, r), atol=1e-14)


@pytest.mark.parametrize("steps", [-1, 251])
def test_impossible_numbers_of_steps_raise(steps):
    with pytest.raises(ValueError, match="steps"):
        EdgeExtension((4, 4), None, None, steps)
