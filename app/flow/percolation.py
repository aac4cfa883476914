"""Sets of open cells through which a fluid can cross a patch."""

from collections import defaultdict

import numpy as np

from app.halfspace.connected_sets import label_connected_sets
from app.parallel.halo import fetch_row_before


def find_percolating_sets(is_open, grid, along, slabs, comm=None):
    """Find the sets of open cells that connect two sides of a patch. Collective.

    If the patch repeats in the direction of the pressure drop, these are the sets that connect a cell with its copy in
    another period.

    Parameters
    ----------
    is_open : ndarray of bool, shape (local rows, nx)
    grid : Grid
    along : {"x", "y"}
        Direction of the pressure drop.
    slabs, comm : Slabs, mpi4py communicator or None
        Distribution of the rows; None if this rank has all rows.

    Returns
    -------
    sets : ndarray of int, shape (local rows, nx)
        Number of the percolating set of each cell, from 1 on; 0 in all other cells.
    count : int
        Number of percolating sets.
    """
    repeats_y, repeats_x = grid.repeats
    repeats, across = (repeats_x, "y" * repeats_y) if along == "x" else (repeats_y, "x" * repeats_x)
    labels, sizes = label_connected_sets(is_open, across, slabs, comm)
    sides = labels[:, 0], labels[:, -1]
    if along == "y":
        last = fetch_row_before(labels, True, slabs, comm, 0)
        sides = (labels[0], last) if slabs.local and not slabs.rows.start else (last[:0], last[:0])
    first, last = (np.concatenate(comm.allgather(side) if comm else [side]) for side in sides)
    number = np.zeros(len(sizes) + 1, int)
    if repeats:
        touching = (first > 0) & (last > 0)
        for members in _find_winding_sets(first[touching].tolist(), last[touching].tolist()):
            number[members] = number.max() + 1
    else:
        both = np.intersect1d(first[first > 0], last)
        number[both] = np.arange(1, len(both) + 1)
    return number[labels], int(number.max())


def _find_winding_sets(first, last):
    """Yield the labels of each set that winds around the period.

    `first` and `last` are the labels of cells that touch across the sides of the patch. A set winds around the period
    if one can walk in it across the last side more often than back.
    """
    neighbours, period = defaultdict(set), {}
    for one, other in zip(last, first, strict=True):
        neighbours[one].add((other, 1))
        neighbours[other].add((one, -1))
    for start in neighbours:
        if start in period:
            continue
        period[start], members, winds = 0, [start], False
        for label in members:  # which grow meanwhile
            for other, step in neighbours[label]:
                if other not in period:
                    period[other] = period[label] + step
                    members.append(other)
                winds = winds or period[other] != period[label] + step
        if winds:
            yield members
