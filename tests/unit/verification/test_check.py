"""Figures of checks, and their limits."""

import numpy as np
import pytest

from app.verification.check import Figure, fit_order


@pytest.mark.parametrize(
    ("value", "least", "most", "passed", "limit"),
    [
        (1.0, -np.inf, np.inf, True, ""),
        (np.nan, -np.inf, 1.0, False, "≤ 1"),
        (1.0, 1.0, np.inf, True, "≥ 1"),
        (0.9, 1.0, 2.0, False, "1 to 2"),
        (0, 0, 0, True, "0"),
    ],
)
def test_a_figure_keeps_its_limits_or_not(value, least, most, passed, limit):
    figure = Figure("what", value, least, most)
    assert (figure.passed, figure.limit) == (passed, limit)


def test_fitted_order_is_the_slope_of_errors():
    assert fit_order([10, 20, 40], [3.0, 3.0 / 8, 3.0 / 64]) == pytest.approx(3)
