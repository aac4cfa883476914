"""Compiled loops of the primal form."""

import numpy as np

from app.methods.periodic import loops


def test_overlapping_cells_touch():
    rng = np.random.default_rng(3)
    w, b, contact, admissible = *rng.normal(size=(2, 6, 7)), *(rng.random((2, 6, 7)) < 0.5)
    contact &= admissible
    touches, before, change = contact | (admissible & (w <= b)), w.copy(), np.empty((6, 7))
    loops.touch(w, b, admissible, contact, change)
    np.testing.assert_array_equal(contact, touches)
    np.testing.assert_array_equal(w, np.where(touches, b, before))
    np.testing.assert_array_equal(change, np.where(touches, b - before, 0))
