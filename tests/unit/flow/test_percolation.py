"""Sets of cells that connect two sides of a patch, or two periods."""

import numpy as np
import pytest

from app import Grid
from app.flow.percolation import find_percolating_sets
from app.halfspace.connected_sets import label_connected_sets
from app.parallel.slabs import Slabs


def find(text, periodic, along="x"):
    """Return sets and their number of cells drawn as text."""
    cells = np.array([[letter == "o" for letter in line] for line in text.split()])
    grid = Grid.from_domain(*cells.shape[::-1], (0, 1, 0, 1), periodic)
    return find_percolating_sets(cells, grid, along, Slabs(grid.ny))


def test_sets_percolate_between_sides():
    sets, count = find("oooo. ..... ooooo oo.oo", False)
    assert count == 1 and (sets > 0).tolist() == [[False] * 5, [False] * 5, [True] * 5, [1, 1, 0, 1, 1]]


@pytest.mark.parametrize("along", ["x", "y"])
def test_sides_need_not_touch_across_a_period(along):
    """A channel that ends where the next period is closed does not percolate."""
    shifted = "ooo... ..oooo ...... ......"
    text = shifted if along == "x" else " ".join("".join(row) for row in zip(*shifted.split(), strict=True))
    assert find(text, False, along)[1] == 1
    assert find(text, True, along)[1] == 0
    across = {"x": "y", "y": "x"}[along]
    assert find(text, across, along)[1] == 1 and find(text, along, along)[1] == 0


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("periodic", [True, "along"])
def test_sets_of_a_period_connect_cells_with_their_copies(along, periodic):
    """Compared with the connected cells of many periods, side by side."""
    shape, periods, axis = (5, 6), 11, 1 if along == "x" else 0
    periodic = along if periodic == "along" else True
    grid = Grid.from_domain(*shape[::-1], (0, 1, 0, 1), periodic)
    across = {True: {"x": "y", "y": "x"}[along]}.get(periodic, "")
    counts = []
    for seed in range(200):
        cells = np.random.default_rng(seed).random(shape) < 0.6
        sets, count = find_percolating_sets(cells, grid, along, Slabs(grid.ny))
        labels = label_connected_sets(np.concatenate([cells] * periods, axis=axis), across)[0]
        copies = np.array(np.split(labels, periods, axis=axis))
        middle = copies[periods // 2]
        percolates = ((copies == middle).sum(axis=0) > 1) & cells
        assert np.array_equal(sets > 0, percolates)
        assert count == len(label_connected_sets(percolates, grid.periodic)[1])
        counts.append(count)
    assert 0 in counts and 1 in counts


def test_several_sets_percolate():
    sets, count = find("ooo ... ooo ...", True)
    assert count == 2 and sets[0].tolist() == [sets[0, 0]] * 3 and sets[0, 0] != sets[2, 0] > 0
