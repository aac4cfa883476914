"""Stopping test of the default methods."""

import pytest

from app.contact.updates import Gaps
from app.methods.stopping import IN_CONTACT, ROUNDING_RESIDUAL, InexactStop


class Norms:
    """State with norms of h only."""

    def __init__(self, whole, inside):
        self.h_norm, self._inside = whole, inside

    def on_contact(self, with_h):
        return Gaps(1, 0.0, 0.0, h=self._inside)


def test_small_contact_is_solved_in_its_own_norm():
    stop = InexactStop(1e-6, 100)
    assert stop.allowed(Norms(10.0, 0.0)) == pytest.approx(1e-6 * 10)  # nothing there to measure
    assert stop.allowed(Norms(10.0, 5.0)) == pytest.approx(1e-6 * 10)
    assert stop.allowed(Norms(10.0, 1e-3)) == pytest.approx(IN_CONTACT * 1e-6 * 1e-3)
    assert InexactStop(1e-15, 100).allowed(Norms(10.0, 1e-3)) == pytest.approx(
        min(1e-14, ROUNDING_RESIDUAL * 1e-3)
    )
