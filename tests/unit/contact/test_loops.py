"""Compiled loops of the contact state."""

import numpy as np
import pytest

from app.contact import loops


def test_rounding_of_a_sum_is_known():
    x = np.array([[1.0, 1e-17, 1e-17], [5.0, -1.0, 1e-17]])
    mask = np.array([[True, True, True], [False, True, True]])
    total, lost = loops.compensated_sum(x, mask)
    assert total + lost == pytest.approx(3e-17, rel=1e-9)
