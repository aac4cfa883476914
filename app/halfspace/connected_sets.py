"""Sets of cells connected by sides, also across a periodic boundary."""

import numpy as np
from scipy import ndimage

from app.halfspace.grid import repeats_in, row_blocks
from app.parallel.halo import fetch_row_before

_BLOCK_CELLS = 1 << 22  # Cells counted together; each block makes an array with a count for each set.


def label_connected_sets(cells, periodic=False, slabs=None, comm=None):
    """Label connected sets of cells. Collective over `comm`.

    Each rank labels its own rows. Sets that are connected across ranks or across the boundary of a periodic patch are
    found from pairs of labels, so no rank needs all cells.

    Parameters
    ----------
    cells : ndarray of bool, shape (local rows, nx)
        True in the cells of the sets, on the rows of this rank.
    periodic : bool or str
        As the attribute of `Grid`. Sets continue across the boundary of a periodic patch.
    slabs, comm : Slabs, mpi4py communicator, optional
        Distribution of the rows; by default this rank has all rows.

    Returns
    -------
    labels : ndarray of int, shape (local rows, nx)
        Number of the set of each cell, from 1 on; 0 outside the sets.
    sizes : ndarray of int, shape (sets,)
        Number of cells of each set; the same on all ranks.
    """
    most = cells.shape[1] * (slabs.ny if slabs else len(cells))
    labels = np.zeros(cells.shape, np.int32 if most < np.iinfo(np.int32).max else np.int64)
    [box] = ndimage.find_objects(cells.view(np.uint8), 1) if cells.size else [None]
    box = box or (slice(0), slice(0))
    inside = labels[box]  # other labels stay 0
    count = ndimage.label(cells[box], output=inside) if inside.size else 0
    counts = comm.allgather(count) if comm else [count]
    total = sum(counts)
    if first := sum(counts[: comm.rank if comm else 0]):
        np.add(inside, first, out=inside, where=inside > 0, casting="same_kind")
    repeats_y, repeats_x = repeats_in(periodic)
    before = fetch_row_before(labels, repeats_y, slabs, comm, 0)
    pairs = [np.stack([labels[0], before])] if len(labels) else []
    if repeats_x and len(labels):
        pairs.append(np.stack([labels[:, 0], labels[:, -1]]))
    pairs = np.hstack(pairs) if pairs else np.zeros((2, 0), np.int64)
    one, other = pairs[:, (pairs > 0).all(axis=0)].astype(np.int64) - 1
    # Pairs as single integers: numpy turns an interrupt in a comparison of pairs into a TypeError.
    pairs = np.stack(np.divmod(np.unique(one * total + other), max(total, 1)))
    pairs = np.hstack(comm.allgather(pairs)) if comm else pairs
    if not total:
        return labels, np.zeros(0, np.int64)
    if not pairs.size:
        sizes = np.bincount(inside[inside > 0], minlength=total + 1)[1:]
        return labels, comm.allreduce(sizes) if comm else sizes
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(total, total))
    sets, set_of_label = connected_components(graph, directed=False)
    joined = np.concatenate([[0], set_of_label + 1]).astype(labels.dtype)
    sizes = np.zeros(sets + 1, np.int64)
    for rows in row_blocks(*inside.shape, _BLOCK_CELLS):
        inside[rows] = joined[inside[rows]]
        sizes += np.bincount(inside[rows].ravel(), minlength=sets + 1)
    sizes = sizes[1:]
    return labels, comm.allreduce(sizes) if comm else sizes
