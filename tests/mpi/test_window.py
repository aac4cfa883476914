"""Windows of a grid, and the transfer of fields."""

import numpy as np
import pytest

from app.halfspace.window import Scatter, Window, bounding_boxes
from app.parallel.slabs import Slabs

each_number_of_ranks = pytest.mark.mpi(1, 2, 3, 5)

WINDOWS = [(0, 20, 0, 9), (3, 4, 2, 3), (0, 1, 0, 9), (15, 20, 1, 8), (2, 19, 4, 5)]


@each_number_of_ranks
def test_scatter_and_back_restores_fields_and_masks(comm):
    ny, nx = 20, 9
    outer = Slabs(ny, comm.size, comm.rank, 2)
    numbers = np.arange(ny * nx, dtype=float).reshape(ny, nx)
    for y0, y1, x0, x1 in WINDOWS:
        for block in (1, 2, 8):
            inner = Slabs(y1 - y0, comm.size, comm.rank, block)
            scatter = Scatter(Window(y0, y1, x0, x1), outer, inner, comm)
            for field in (numbers, numbers % 3 == 0):
                part = scatter.forward(field[outer.rows])
                again = np.empty((inner.local, x1 - x0), field.dtype)
                np.testing.assert_array_equal(part, field[y0:y1, x0:x1][inner.rows])
                assert part.dtype == field.dtype
                assert scatter.forward(field[outer.rows], again) is again
                np.testing.assert_array_equal(again, part)
                expected = np.zeros_like(field)
                expected[y0:y1, x0:x1] = field[y0:y1, x0:x1]
                for storage in (None, np.empty(8 * field.size, np.uint8)):
                    back = np.zeros_like(field)[outer.rows]
                    scatter.reverse(part, back, storage)
                    np.testing.assert_array_equal(back, expected[outer.rows])


@each_number_of_ranks
def test_bounding_box_is_the_same_on_all_ranks_and_holds_every_cell(comm):
    slabs = Slabs(20, comm.size, comm.rank)
    mask = np.zeros((20, 9), bool)
    assert bounding_boxes([mask[slabs.rows]], slabs, comm) == [None]
    mask[4, 2] = mask[17, 5] = True
    assert bounding_boxes([mask[slabs.rows]], slabs, comm) == [Window(4, 18, 2, 6)]
