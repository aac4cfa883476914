"""Ghost rows of a slab, on one rank."""

import numpy as np
import pytest

from app.parallel.halo import Halo
from app.parallel.slabs import Slabs


@pytest.mark.parametrize("width", [1, 3, 7, 20])
@pytest.mark.parametrize("rows", [1, 2, 6])
def test_halo_of_one_slab_is_periodic(rows, width):
    field = np.arange(3.0 * rows).reshape(rows, 3)
    before, after = Halo(Slabs(rows), None, width)(field)
    np.testing.assert_array_equal(before, field[np.arange(-width, 0) % rows])
    np.testing.assert_array_equal(after, field[np.arange(width) % rows])
