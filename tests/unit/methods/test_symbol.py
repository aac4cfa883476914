"""Eigenvalues of A continued periodically."""

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.halfspace.periodic_symbol import influence_symbol
from app.methods.symbol import eigenvalues


@pytest.mark.parametrize("aspect", [1.0, 1.7, 0.01, 100.0, 1000.0])
def test_eigenvalues_are_those_of_a_periodic_patch(aspect):
    """For cells of any shape, except the eigenvalue of a constant."""
    grid = Grid(24, 20, aspect, 1.0, periodic="love")
    columns, rows = np.arange(13), np.arange(11)
    expected = influence_symbol(grid, 0.5, columns, rows)
    found = eigenvalues(grid, 0.5, columns / 12, rows / 10)
    assert np.isinf(found[0, 0])
    found[0, 0] = 0.0
    assert (found >= 0).all()
    np.testing.assert_allclose(found, expected, rtol=3e-8)
