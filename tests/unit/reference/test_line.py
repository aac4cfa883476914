"""Line contact of finite length."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.reference.line import LineContact


def test_pressure_carries_the_load():
    contact = LineContact(10.0, 16.0, 115385.0, 20000.0)
    x = (np.arange(2000) + 0.5) / 1000 - 1
    pressure = contact.max_pressure * np.sqrt(1 - x**2)
    assert pressure.sum() * contact.a / 1000 * 16 == pytest.approx(20000, rel=1e-4)
    assert contact.max_pressure == pytest.approx(115385 * contact.a / (2 * 10), rel=1e-12)


@pytest.mark.parametrize("load", [1.0, 1e3, 1e5])
def test_approach_and_load_belong_together(load):
    contact = LineContact(10.0, 16.0, 115385.0, load)
    same = LineContact.from_approach(10.0, 16.0, 115385.0, contact.approach)
    assert same.load == pytest.approx(load, rel=1e-9)


def test_profile_keeps_the_displacement_of_a_uniform_load():
    """Away from the ends, where the width of the contact does not matter."""
    contact = LineContact(10.0, 16.0, 115385.0, 200.0)
    y = np.linspace(-7.5, 7.5, 31)
    line = contact.compliance * np.log((8 - y) * (8 + y))  # of a line load, up to a constant
    drop = contact.crown(y)
    np.testing.assert_allclose(drop, line[15] - line, atol=0.02 * drop.max())
    assert np.isnan(contact.crown(8.01)) and contact.crown(0.0) == 0
    lundberg = contact.compliance * (1.1932 + np.log(16 / (2 * contact.a)))
    assert contact.crown(8.0) == pytest.approx(lundberg, rel=1e-3)


@pytest.mark.parametrize("load", [0, -1.0, np.nan, np.inf, "1"])
def test_wrong_loads_are_refused(load):
    with pytest.raises(InputError, match="load"):
        LineContact(10.0, 16.0, 115385.0, load)
