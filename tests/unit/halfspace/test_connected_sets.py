"""Connected sets of cells."""

import numpy as np
import pytest

from app.halfspace.connected_sets import label_connected_sets


def by_flooding(contact, periodic):
    """Sizes of the patches, from large to small."""
    left, sizes = {tuple(cell) for cell in np.argwhere(contact)}, []
    while left:
        front, size = [left.pop()], 0
        while front:
            j, i = front.pop()
            size += 1
            for cell in ((j + 1, i), (j - 1, i), (j, i + 1), (j, i - 1)):
                if periodic:
                    cell = tuple(np.mod(cell, contact.shape).tolist())
                if cell in left:
                    left.remove(cell)
                    front.append(cell)
        sizes.append(size)
    return sorted(sizes, reverse=True)


@pytest.mark.parametrize("symbol", ["", "spectral"])
@pytest.mark.parametrize("shape", [(17, 23), (1, 9), (8, 1)])
def test_connected_sets_equal_those_of_flood_fill(symbol, shape):
    for seed in range(5):
        contact = np.random.default_rng(seed).random(shape) < 0.5
        labels, sizes = label_connected_sets(contact, bool(symbol))
        assert sorted(sizes, reverse=True) == by_flooding(contact, bool(symbol))
        assert np.array_equal(np.bincount(labels[contact], minlength=len(sizes) + 1)[1:], sizes)


def test_sets_are_connected_across_the_sides_of_one_direction():
    corners = np.zeros((5, 6), bool)
    corners[[0, 0, -1, -1], [0, -1, 0, -1]] = True
    for periodic, expected in ((False, [1, 1, 1, 1]), ("x", [2, 2]), ("y", [2, 2]), (True, [4])):
        assert sorted(label_connected_sets(corners, periodic)[1]) == expected
    labels, _ = label_connected_sets(corners, "x")
    assert labels[0, 0] == labels[0, -1] != labels[-1, 0]
