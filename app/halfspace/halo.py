"""Rows beside a slab of a periodic grid: the neighbours', or those from the other end of the patch."""

from __future__ import annotations

from app.halfspace.communication import Fetch


class Halo:
    """Fetches some rows before and after this rank's, over the period, from whatever ranks have them.

    Parameters
    ----------
    slabs : Slabs
    comm : mpi4py communicator or None
        Ranks that share the rows; None if all are here.
    width : int
        Rows on either side.
    """

    def __init__(self, slabs, comm, width):
        first, last = slabs.bounds(1 if comm is None else comm.size)
        by = width * (last > first)
        self._fetch = Fetch(slabs, [(first - by, first), (last, last + by)], comm)

    def __call__(self, field):
        """Fetch the rows of a field.

        Collective.

        Parameters
        ----------
        field : ndarray, shape (local rows, columns)

        Returns
        -------
        before, after : ndarray, shape (width, columns)
            Of the field's type; without rows if there are none here.
        """
        rows = self._fetch(field)
        half = len(rows) // 2
        return rows[:half], rows[half:]
