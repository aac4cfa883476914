"""Compiled loops between rows and strips of columns."""

import numpy as np
import pytest

from app.halfspace.fft import strips


@pytest.mark.parametrize("columns", [1, 15, 16, 17, 40])
def test_rows_are_stored_as_strips_and_come_back(columns):
    """A strip has all rows of its columns; the last one may be narrower."""
    height, start = 5, 2
    rows = np.arange(3.0 * columns).reshape(3, columns) + 1j
    stored = np.zeros(height * columns, complex)
    strips.copy_rows(rows, stored, height, start, True)
    for first in range(0, columns, strips.STRIP):
        last = min(first + strips.STRIP, columns)
        strip = stored[height * first : height * last].reshape(height, last - first)
        np.testing.assert_array_equal(strip[start:], rows[:, first:last])
        assert not strip[:start].any()
    back = np.zeros_like(rows)
    strips.copy_rows(back, stored, height, start, False)
    np.testing.assert_array_equal(back, rows)


@pytest.mark.parametrize("length", [2, 7, 8])
def test_two_real_rows_are_transformed_as_one_complex_row(length):
    a, b = np.random.default_rng(1).normal(size=(2, length))
    both, half = np.fft.fft(a + 1j * b), length // 2 + 1
    split = np.empty((2, half), complex)
    strips._split(both, 0, *split)
    np.testing.assert_allclose(split, np.fft.rfft([a, b]), rtol=0, atol=1e-13)
    united = np.empty(length, complex)
    strips._unite(united, 0, *split)
    np.testing.assert_allclose(united, both, rtol=0, atol=1e-13)


@pytest.mark.parametrize("rows", [1, 2, 5])
@pytest.mark.parametrize("masked", [False, True])
def test_pairs_of_rows_are_padded_and_masked(rows, masked):
    rng = np.random.default_rng(rows)
    p = rng.normal(size=(rows, 3))
    mask = rng.random((rows, 3)) < 0.5 if masked else np.zeros((rows, 0), bool)
    expected = np.where(mask, p, 0.0) if masked else p
    pairs = np.full(((rows + 1) // 2, 4), np.nan + 0j)
    strips._pair(p, mask, pairs)
    np.testing.assert_array_equal(pairs[: rows // 2, :3], expected[: rows // 2 * 2 : 2] + 1j * expected[1::2])
    assert (pairs[:, 3] == 0).all()
    out = np.full((rows, 3), np.nan)
    strips._unpair(pairs, mask, out)
    np.testing.assert_array_equal(out, expected)
