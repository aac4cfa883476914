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
    values = eigenvalues(grid, 0.5, columns / 12, rows / 10)
    assert np.isinf(values[0, 0])
    values[0, 0] = 0.0
    assert (values >= 0).all()
    np.testing.assert_allclose(values, expected, rtol=3e-8)
