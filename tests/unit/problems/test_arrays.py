"""Validation of arrays of users."""

from fractions import Fraction

import numpy as np
import pytest

from app.base.errors import InputError
from app.problems.arrays import check_size, lattice, real_numbers, share_or_copy


def test_numbers_are_copied_as_float64_and_masked_ones_are_nan():
    values = np.array([1.0, 2.0])
    copy = real_numbers("h", values)
    copy[0] = 5.0
    assert values[0] == 1.0
    masked = real_numbers("h", np.ma.masked_equal([[1, 2], [3, 2]], 2))
    np.testing.assert_array_equal(masked, [[1.0, np.nan], [3.0, np.nan]])
    np.testing.assert_array_equal(real_numbers("h", [1, Fraction(1, 2)]), [1.0, 0.5])


def test_only_read_only_arrays_are_shared():
    values = np.arange(6.0).reshape(2, 3).copy()
    part = values[1:]
    part.flags.writeable = False  # but `values` can be changed
    assert not np.shares_memory(share_or_copy("h", part), values)
    assert not np.shares_memory(share_or_copy("h", values), values)
    values.flags.writeable = False
    for shared in (values, values[:, ::2]):
        assert np.shares_memory(share_or_copy("h", shared), values)
    whole = np.arange(3)
    whole.flags.writeable = False
    assert share_or_copy("h", whole).dtype == float
    masked = np.ma.masked_equal(values, 2.0)
    masked.flags.writeable = False
    assert np.isnan(share_or_copy("h", masked)[0, 2])


@pytest.mark.parametrize("values", [None, "1", ["a"], [1j], True, [True, False], [[1, 2], [3]], [None, "x"]])
def test_other_values_are_refused(values):
    with pytest.raises(InputError, match=r"^h: must be heights$"):
        real_numbers("h", values, "heights")


def test_a_lattice_is_columns_and_rows_from_its_origin():
    x, y = lattice([1, 2, 3], [4, 5], (1.0, 4.0))
    np.testing.assert_array_equal(x, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(y, [0.0, 1.0])
    with pytest.raises(InputError, match=r"^x, y: have shapes \(1, 2\) and \(2,\)"):
        lattice([[1, 2]], [4, 5], (0.0, 0.0))


def test_numbers_whose_squares_overflow_are_refused_in_their_place():
    values = np.array([[0.0, np.nan], [1.0, -1e200]])
    check_size("h", values[:1])
    with pytest.raises(InputError, match=r"^h: -1e\+?200 in row 8, column 1; "):
        check_size("h", values, first_row=7)
