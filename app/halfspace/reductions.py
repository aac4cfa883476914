"""Numbers from arrays and ranks: sums that may be compiled to vector instructions, a test, reductions over ranks."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from app.compiled import njit

# A loop over one row, without branches and in a function of its own, becomes vector instructions if its sums may be
# taken in any order. The order is the same on any number of ranks.
any_order = njit(fastmath={"reassoc", "contract"})


@njit()
def any_nonzero(block):
    """Whether anything is not zero; stops at the first row with something."""
    for j in range(block.shape[0]):
        some = False
        for i in range(block.shape[1]):
            some |= block[j, i] != 0
        if some:
            return True
    return False


def sum_over(comm, values):
    """Sum a few numbers over the ranks of `comm`; None: return them as they are. Collective."""
    return values if comm is None else _reduce(comm, values, MPI.SUM)


def minimum_over(comm, values):
    """Smallest of each of a few numbers over the ranks of `comm`; None: return them as they are. Collective."""
    return values if comm is None else _reduce(comm, values, MPI.MIN)


def _reduce(comm, values, operation):
    result = np.array(values, dtype=float)
    comm.Allreduce(result.copy(), result, operation)
    return result
