"""Units of lengths."""

import pytest

from app.base.units import choose_length_unit


@pytest.mark.parametrize(
    "largest, per_mm, name", [(2.0, 1.0, "mm"), (0.1, 1e3, "µm"), (1e-5, 1e6, "nm"), (5e4, 1e-3, "m")]
)
def test_lengths_stand_in_a_unit_that_suits_them(largest, per_mm, name):
    assert choose_length_unit(largest) == (per_mm, name)
