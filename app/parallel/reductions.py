"""Loops over rows that become vector instructions, numbers from arrays, reductions over ranks."""

from __future__ import annotations

from functools import cache

import numpy as np
from numba.extending import overload

from app.base.mpi import MPI
from app.base.numba_cache import njit

# A loop over one row, without branches and in a function of its own, becomes vector instructions if its sums may be
# taken in any order. The order is the same on any number of ranks.
njit_reassoc = njit(fastmath={"reassoc", "contract"})


def add_tuples(sums, more):
    """Sums of two tuples, number by number: what rows add up to. In compiled loops only."""
    raise NotImplementedError


@overload(add_tuples)
def _add_tuples(sums, more):
    if len(sums) == 1:
        return lambda sums, more: (sums[0] + more[0],)
    return lambda sums, more: (sums[0] + more[0],) + add_tuples(sums[1:], more[1:])  # noqa: RUF005  numba has no stars


@njit_reassoc
def add_row(a, scale, b):
    """a += scale b."""
    for i in range(a.size):
        a[i] += scale * b[i]


@njit_reassoc
def copy_row(row, out):
    """out = row, whatever their types."""
    for i in range(row.size):
        out[i] = row[i]


@njit_reassoc
def mix_rows(one, weight, other, out):
    """out = weight one + (1 - weight) other."""
    for i in range(out.size):
        out[i] = weight * one[i] + (1 - weight) * other[i]


@njit_reassoc
def scale_row(row, factor, out):
    """out = factor row."""
    for i in range(row.size):
        out[i] = factor * row[i]


@njit_reassoc
def add_masked(row, mask, out):
    """out += row where the mask is set."""
    nothing = row.dtype.type(0)
    for i in range(row.size):
        out[i] += row[i] if mask[i] else nothing


@njit_reassoc
def stencil_sum(above, here, below, i, x, y, diagonal):
    """What a 3 x 3 stencil makes of the neighbours of cell i, of rows with one cell more on either side."""
    return (
        x * (here[i] + here[i + 2])
        + y * (above[i + 1] + below[i + 1])
        + diagonal * ((above[i] + above[i + 2]) + (below[i] + below[i + 2]))
    )


@njit()
def copy_slab_row(t, field, before, after, out):
    """out = row t of the rows before a slab, its own, and those after it, all counted together."""
    j = t - len(before)
    if j < 0:
        copy_row(before[t], out)
    elif j < len(field):
        copy_row(field[j], out)
    else:
        copy_row(after[j - len(field)], out)


@njit()
def wrap_ends(row, nx, width):
    """Into the ends, of some cells each, of a row of nx cells: what comes there over a period, however short."""
    for i in range(width):  # from inside: where there are fewer cells, what is there already goes on
        row[width - 1 - i], row[width + nx + i] = row[width - 1 - i + nx], row[width + i]


@njit()
def nonzero_span(row):
    """First place where a row of a mask is set, and one past the last; 0, 0 if it is nowhere."""
    first, last = 0, row.size
    while last > 0 and not row[last - 1]:
        last -= 1
    while first < last and not row[first]:
        first += 1
    return first, last


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
    if comm is None:
        return values
    result = np.array(values, dtype=float)
    comm.Allreduce(result.copy(), result, MPI.SUM)
    return result


def minimum_over(comm, values):
    """Smallest of each of a few numbers over the ranks of `comm`; None: return them as they are. Collective.

    NaN is the smallest, whichever rank has it: MPI.MIN would lose it or not.
    """
    if comm is None:
        return values
    return sums_and_minima(comm, [], np.ravel(values))[1].reshape(np.shape(values))


def sums_and_minima(comm, sums, lowest):
    """Sum some numbers and find the smallest of each of others, by one reduction. Collective; `comm` may be None."""
    sums, lowest = np.array(sums, float), np.array(lowest, float)
    if comm is None:
        return sums, lowest
    # The first number tells the operation how many are to be summed; one element, as no library may cut it.
    found = np.concatenate([[sums.size], sums, lowest])
    kind, operation = _mixed(found.size)
    comm.Allreduce([found.copy(), 1, kind], [found, 1, kind], operation)
    return found[1 : 1 + sums.size], found[1 + sums.size :]


@cache
def _mixed(size):
    return MPI.DOUBLE.Create_contiguous(size).Commit(), _operation()


@cache
def _operation():
    def merge(one, other, kind):
        a, b = np.frombuffer(one), np.frombuffer(other)
        summed = 1 + int(b[0])
        b[1:summed] += a[1:summed]
        np.minimum(a[summed:], b[summed:], out=b[summed:])

    return MPI.Op.Create(merge, commute=True)
