"""Numbers gathered from the ranks that share a grid, and loops whose sums may be compiled to vector instructions."""

from __future__ import annotations

import numba
import numpy as np
from mpi4py import MPI

# A loop over one row, without branches and in a function of its own, becomes vector instructions if its sums may be
# taken in any order. The order is the same on any number of ranks.
any_order = numba.njit(cache=True, fastmath={"reassoc", "contract"})


def sum_over(comm, values):
    """Sum a few numbers over the ranks of `comm`, which may be None. Collective."""
    return _reduce(comm, values, MPI.SUM)


def minimum_over(comm, values):
    """Smallest of each of a few numbers over the ranks of `comm`, which may be None. Collective."""
    return _reduce(comm, values, MPI.MIN)


def _reduce(comm, values, operation):
    result = np.array(values, dtype=float)
    if comm is not None:
        comm.Allreduce(result.copy(), result, operation)
    return result
