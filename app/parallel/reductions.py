"""Compiled loops over cells of a row, and reductions over MPI ranks."""

from functools import cache

import numpy as np
from numba.extending import overload

from app.base.mpi import MPI
from app.base.numba_cache import njit

# LLVM vectorises a loop over one row if it has no branches, is a function of its own, and may reassociate its sums.
# The order of the sums is the same on any number of ranks.
njit_reassoc = njit(fastmath={"reassoc", "contract"})


def add_tuples(sums, more):
    """Return the sum of two tuples, entry by entry, in compiled code."""
    raise NotImplementedError


@overload(add_tuples)
def _add_tuples(sums, more):
    entries = "".join(f"sums[{i}] + more[{i}], " for i in range(len(sums)))
    # One function; a recursion would compile one for each entry.
    return eval(f"lambda sums, more: ({entries})")


@njit_reassoc
def sum_row(row):
    """Return a row's sum; True counts as 1."""
    total = 0
    for i in range(row.size):
        total += row[i]
    return total


@njit_reassoc
def add_row(a, scale, b):
    """Compute a += scale b for a row."""
    for i in range(a.size):
        a[i] += scale * b[i]


@njit(fastmath={"contract"})
def add_two_rows(a, scale, b, other_scale, c):
    """Compute a += scale b and then a += other_scale c, for rows."""
    for i in range(a.size):
        a[i] = a[i] + scale * b[i] + other_scale * c[i]


@njit_reassoc
def copy_row(row, out):
    """Copy a row to `out`, which may have another floating-point type."""
    for i in range(row.size):
        out[i] = row[i]


@njit_reassoc
def mix_rows(one, weight, other, out):
    """Compute the mean out = weight * one + (1 - weight) * other."""
    for i in range(out.size):
        out[i] = weight * one[i] + (1 - weight) * other[i]


@njit_reassoc
def scale_row(row, factor, out):
    """Compute out = factor * row."""
    for i in range(row.size):
        out[i] = factor * row[i]


@njit_reassoc
def add_masked(row, mask, out):
    """Compute out += row inside the mask."""
    zero = row.dtype.type(0)
    for i in range(row.size):
        out[i] += row[i] if mask[i] else zero


@njit_reassoc
def stencil_sum(above, here, below, i, x, y, diagonal):
    """Return the weighted sum of cell i's eight neighbours.

    `above`, `here` and `below` are three rows with a ghost cell at each end. `x`, `y` and `diagonal` are the weights of
    the neighbours in x, in y and across corners.
    """
    return (
        x * (here[i] + here[i + 2])
        + y * (above[i + 1] + below[i + 1])
        + diagonal * ((above[i] + above[i + 2]) + (below[i] + below[i + 2]))
    )


@njit()
def copy_slab_row(t, field, before, after, out):
    """Copy a slab's row t, counted from the first ghost row, to `out`."""
    j = t - len(before)
    if j < 0:
        copy_row(before[t], out)
    elif j < len(field):
        copy_row(field[j], out)
    else:
        copy_row(after[j - len(field)], out)


@njit()
def wrap_ends(row, nx, width):
    """Fill `width` ghost cells at a periodic row's ends."""
    for i in range(width):  # from inside: with nx < width, ghost cells are copied on
        row[width - 1 - i], row[width + nx + i] = row[width - 1 - i + nx], row[width + i]


@njit()
def nonzero_span(row):
    """Return first and end index of a row's nonzeros."""
    first, last = 0, row.size
    while last > 0 and not row[last - 1]:
        last -= 1
    while first < last and not row[first]:
        first += 1
    return first, last


@njit()
def _count_nonzero(row):
    count = 0
    for i in range(row.size):
        count += row[i] != 0
    return count


@njit()
def any_nonzero(block):
    """Return whether any entry of an array is nonzero."""
    j = 0
    while j < block.shape[0] and not _count_nonzero(block[j]):
        j += 1
    return j < block.shape[0]


def sum_over(comm, values):
    """Return each value's sum over all ranks. Collective."""
    if comm is None:
        return values
    result = np.array(values, dtype=float)
    comm.Allreduce(result.copy(), result, MPI.SUM)
    return result


def minimum_over(comm, values):
    """Return each value's minimum over all ranks. Collective.

    NaN counts as the smallest number. With MPI.MIN the result would depend on which rank has the NaN.
    """
    if comm is None:
        return values
    return sums_and_minima(comm, [], np.ravel(values))[1].reshape(np.shape(values))


def sums_and_minima(comm, sums, lowest):
    """Return sums and minima over all ranks by one reduction. Collective."""
    sums, lowest = np.array(sums, float), np.array(lowest, float)
    if comm is None:
        return sums, lowest
    # The first number is the count of the sums. All are one element, so that no MPI library may split them.
    packed = np.concatenate([[sums.size], sums, lowest])
    kind = _element(packed.size)
    comm.Allreduce([packed.copy(), 1, kind], [packed, 1, kind], _operation())
    return packed[1 : 1 + sums.size], packed[1 + sums.size :]


@cache
def _element(size):
    return MPI.DOUBLE.Create_contiguous(size).Commit()


@cache
def _operation():
    def merge(one, other, kind):
        a, b = np.frombuffer(one), np.frombuffer(other)
        end = 1 + int(b[0])
        b[1:end] += a[1:end]
        np.minimum(a[end:], b[end:], out=b[end:])

    return MPI.Op.Create(merge, commute=True)
