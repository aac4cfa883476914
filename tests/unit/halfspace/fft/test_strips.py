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
    strips.store_rows(rows, stored, height, start)
    for first in range(0, columns, strips.STRIP):
        last = min(first + strips.STRIP, columns)
        strip = stored[height * first : height * last].reshape(height, last - first)
        np.testing.assert_array_equal(strip[start:], rows[:, first:last])
        assert not strip[:start].any()
    back = np.zeros_like(rows)
    strips._load_rows(back, stored, height, start)
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


def test_masked_rows_are_paired_and_come_back():
    rng = np.random.default_rng(1)
    rows, mask = rng.normal(size=(2, 7)), rng.random((2, 7)) < 0.5
    pair, out = np.empty(7, complex), np.empty((2, 7))
    strips._pair_masked_row(*rows, *mask, pair)
    np.testing.assert_array_equal([pair.real, pair.imag], np.where(mask, rows, 0))
    strips._pair_row(*rows, pair)
    np.testing.assert_array_equal([pair.real, pair.imag], rows)
    strips._unpair_masked_row(pair, *mask, *out)
    np.testing.assert_array_equal(out, np.where(mask, rows, 0))
    strips._unpair_row(pair, *out)
    np.testing.assert_array_equal(out, rows)
