"""Fixtures of the tests of app/contact."""

import numpy as np
import pytest

from app.contact.distance import UndeformedDistance
from app.contact.state import ContactState
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator


@pytest.fixture
def state():
    """A contact state on 5 x 4 cells with one inadmissible cell; `shape` is its undeformed distance."""
    grid = Grid(5, 4, 1.0, 0.5)
    shape = np.random.default_rng(0).normal(size=grid.shape)
    shape[0, 0] = np.nan
    operator = InfluenceOperator(grid, UNIT)
    state = ContactState(operator, UndeformedDistance(operator, shape - np.nanmin(shape), np.nanmin(shape)))
    state.shape = shape
    yield state
    state.destroy()
    state.distance.destroy()
