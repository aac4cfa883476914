"""Ghost rows: copies of other ranks' rows next to a slab.

A slab has the consecutive rows of one rank. On a periodic grid, ghost rows may also be copies of rows on the other side
of the patch.
"""

import numpy as np

from app.parallel.fetch import Fetch


class _GhostRows:
    """Exchange of ghost rows before and after a slab.

    `before` and `after` are pairs (first, end) of integer arrays with an entry for each rank: the rank gets the rows
    with numbers from `first` to `end` - 1, as in `Fetch`.
    """

    def __init__(self, slabs, before, after, comm):
        self._fetch = Fetch(slabs, [before, after], comm)
        rank = 0 if comm is None else slabs.rank
        self._before = int(before[1][rank] - before[0][rank])

    def __call__(self, field):
        """Return ghost rows before and after a field. Collective."""
        rows = self._fetch(field)
        return rows[: self._before], rows[self._before :]


class Halo(_GhostRows):
    """Exchange of `width` ghost rows before and after slabs.

    On a periodic patch the ghost rows continue on the other side of the patch. On other patches there are fewer ghost
    rows at the ends of the patch. `comm` is None if this rank has all rows.
    """

    def __init__(self, slabs, comm, width, periodic=True):
        first, last = slabs.bounds(1 if comm is None else comm.size)
        low, high = first - width, last + width
        if not periodic:
            low, high = np.maximum(low, 0), np.minimum(high, slabs.ny)
        nonempty = last > first
        low, high = np.where(nonempty, (low, high), (first, last))
        super().__init__(slabs, (low, first), (last, high), comm)


class CoarseHalo(_GhostRows):
    """Exchange of coarse rows needed to interpolate fine rows.

    `slabs` is the distribution of the fine rows. The coarse rows are distributed as ``slabs.surround()``, on a periodic
    grid as ``slabs.coarsen(2)``. The attribute `first` is the number of the first coarse row that this rank needs.
    Coarse row 1 consists of fine rows 0 and 1. Coarse row 0 lies before the grid; on a periodic grid it is a copy of
    the last coarse row.
    """

    def __init__(self, slabs, comm, periodic=False):
        coarse = slabs.coarsen(2) if periodic else slabs.surround()
        size, rank = (1, 0) if comm is None else (comm.size, slabs.rank)
        (first, last), (begin, end) = slabs.bounds(size), coarse.bounds(size)
        low, high = first // 2 - periodic, (last - 1) // 2 + 3 - periodic
        high = high if periodic else np.minimum(high, coarse.ny)
        nonempty = last > first
        self.first = int(low[rank]) + periodic
        low, high = np.where(nonempty, (low, high), (begin, end))
        super().__init__(coarse, (low, begin), (end, high), comm)


def fetch_row_before(field, periodic, slabs, comm, beyond):
    """Return the row before this rank's rows. Collective.

    `field` has the rows of this rank. On a periodic patch the last row is before the first one. On other patches the
    row before the first row is filled with the value `beyond`. `slabs` and `comm` are None if this rank has all rows.
    """
    if comm is None:
        return field[-1] if periodic and len(field) else np.full(field.shape[1], beyond, field.dtype)
    first, last = slabs.bounds(comm.size)
    low = np.where(last > first, first - 1 if periodic else np.maximum(first - 1, 0), first)
    rows = Fetch(slabs, [(low, first)], comm)(field)
    return rows[0] if len(rows) else np.full(field.shape[1], beyond, field.dtype)
