"""Sets of cells that hang together by faces, not by corners alone; on a periodic patch across its sides, too."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from app.halfspace.grid import row_blocks
from app.parallel.halo import fetch_row_before

_CELLS_AT_ONCE = 1 << 22  # counted together; each time there is a count for each set


def label_connected_sets(cells, periodic=False, slabs=None, comm=None):
    """Tell the sets of some cells apart.

    Collective over `comm`. Each rank looks at its own rows; which of their sets are one across ranks, or across the
    sides of a periodic patch, is found from pairs of numbers: no rank sees all cells.

    Parameters
    ----------
    cells : ndarray of bool, shape (local rows, nx)
    periodic : bool
        What leaves on one side comes in on the other.
    slabs : Slabs, optional
    comm : mpi4py communicator, optional
        Ranks that share the rows; default: all are here.

    Returns
    -------
    labels : ndarray of int, shape (local rows, nx)
        0 in other cells, else from 1 on.
    sizes : ndarray of int, shape (sets,)
        Cells of each; the same on all ranks.
    """
    box = tuple(_span(cells.any(axis=axis)) for axis in (1, 0))
    most = cells.shape[1] * (max(slabs.counts) if slabs else len(cells))  # on any rank: labels have one type
    labels = np.zeros(cells.shape, np.int32 if most < np.iinfo(np.int32).max else np.int64)
    inside = labels[box]  # others are nowhere
    count = ndimage.label(cells[box], output=inside) if inside.size else 0
    counts = comm.allgather(count) if comm else [count]
    if sum(counts) > np.iinfo(labels.dtype).max:
        labels = labels.astype(np.int64)
        inside = labels[box]
    if first := sum(counts[: comm.rank if comm else 0]):
        np.add(inside, first, out=inside, where=inside > 0, casting="same_kind")
    before = fetch_row_before(labels, periodic, slabs, comm, 0)
    pairs = [np.stack([labels[0], before])] if len(labels) else []
    if periodic and len(labels):
        pairs.append(np.stack([labels[:, 0], labels[:, -1]]))
    pairs = np.hstack(pairs) if pairs else np.zeros((2, 0), np.int64)
    parts = sum(counts)
    one, other = pairs[:, (pairs > 0).all(axis=0)].astype(np.int64) - 1
    # As whole numbers: in numpy's comparison of pairs an interrupt becomes a TypeError.
    pairs = np.stack(np.divmod(np.unique(one * parts + other), max(parts, 1)))
    pairs = np.hstack(comm.allgather(pairs)) if comm else pairs
    if not parts:
        return labels, np.zeros(0, np.int64)
    if not pairs.size:
        sizes = np.bincount(inside[inside > 0], minlength=parts + 1)[1:]
        return labels, comm.allreduce(sizes) if comm else sizes
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    same = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(parts, parts))
    sets, of = connected_components(same, directed=False)
    joined, sizes = np.concatenate([[0], of + 1]).astype(labels.dtype), np.zeros(sets + 1, np.int64)
    for rows in row_blocks(*inside.shape, _CELLS_AT_ONCE):
        inside[rows] = joined[inside[rows]]
        sizes += np.bincount(inside[rows].ravel(), minlength=sets + 1)
    sizes = sizes[1:]
    return labels, comm.allreduce(sizes) if comm else sizes


def _span(mask):
    """From the first to the last place where a mask is set."""
    places = np.flatnonzero(mask)
    return slice(places[0], places[-1] + 1) if places.size else slice(0)
