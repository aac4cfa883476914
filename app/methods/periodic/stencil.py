"""Compiled sweeps with B's 3 x 3 centre.

B, the inverse of A, decays like 1 / r^3, so its 3 x 3 centre is enough for short waves. One pass over the rows makes
all sweeps, so that the rows stay in the cache: at time t, sweep m is made on row j = t - m + 1. ``swept[m]`` has the
last three rows after sweep m. ``sources`` has the right-hand sides of rows until their last sweep. The halo is swept,
too, one row less with each sweep; columns are periodic. Arrays have the rows of this rank; work rows have one more cell
at each end. Work arrays are in single precision, which is enough for a preconditioner and a guess.
"""

import numpy as np

from app.base.numba_cache import njit
from app.contact.bounds_loops import clipped_displacement
from app.parallel.reductions import (
    add_row,
    copy_row,
    copy_slab_row,
    mix_rows,
    njit_reassoc,
    stencil_sum,
    wrap_ends,
)

# Weights of the neighbours in x, in y, and on the diagonals, over that of the cell


@njit_reassoc
def _sweep_row(source, free, above, here, below, wx, wy, wd, share, out):
    for i in range(source.size):
        neighbours = stencil_sum(above, here, below, i, wx, wy, wd)
        swept = here[i + 1] + share * (source[i] - neighbours - here[i + 1])
        out[i + 1] = swept if free[i] else np.float32(0)


@njit_reassoc
def _clipped_row(source, lowest, room, above, here, below, wx, wy, wd, out):
    for i in range(source.size):
        neighbours = stencil_sum(above, here, below, i, wx, wy, wd)
        out[i + 1] = clipped_displacement(source[i] - neighbours, lowest[i], room, i)


@njit_reassoc
def _first_clipped_row(source, lowest, room, out):
    for i in range(source.size):
        out[i] = clipped_displacement(source[i], lowest[i], room, i)


@njit()
def _row_of(rooms, k):
    """Return row k, or None if there are no rows."""
    if rooms is None:
        return None
    return rooms[k]


@njit_reassoc
def _first_row(s, free, scale, share, more, source, inside, out):
    zero = np.float32(0)
    for i in range(s.size):
        here = np.float32(s[i] * scale) if free[i] else zero
        source[i] = here
        out[i] = share * here + (more[i] if free[i] else zero)
    copy_row(free, inside)


# Row t is counted from the first of the halo, as in `copy_slab_row`; here types may differ.


@njit()
def _first_at(t, s, s_before, s_after, free, f_before, f_after, scale, share, more, source, inside, out):
    j = t - len(s_before)
    if j < 0:
        _first_row(s_before[t], f_before[t], scale, share, more, source, inside, out)
    elif j < len(s):
        _first_row(s[j], free[j], scale, share, more, source, inside, out)
    else:
        k = j - len(s)
        _first_row(s_after[k], f_after[k], scale, share, more, source, inside, out)


# Factors are 1, 2 or 4; these loops are unrolled for vector instructions.


@njit_reassoc
def _add_fours(row, scale, out):
    for i in range(np.uint64(out.size)):
        k = np.uint64(4) * i
        out[i] += scale * ((row[k] + row[k + np.uint64(1)]) + (row[k + np.uint64(2)] + row[k + np.uint64(3)]))


@njit_reassoc
def _add_twos(row, scale, out):
    for i in range(np.uint64(out.size)):
        k = np.uint64(2) * i
        out[i] += scale * (row[k] + row[k + np.uint64(1)])


@njit_reassoc
def _add_ones(row, scale, out):
    for i in range(out.size):
        out[i] += scale * row[i]


@njit()
def _add_means(row, factor, scale, out):
    full = row.size // factor
    if factor == 4:
        _add_fours(row, scale, out[:full])
    elif factor == 2:
        _add_twos(row, scale, out[:full])
    else:
        _add_ones(row, scale, out[:full])
    for i in range(factor * full, row.size):  # the last cell may be smaller
        out[full] += scale * row[i]


@njit_reassoc
def _fours(wide, row):
    near, far = np.float32(0.875), np.float32(0.625)
    rest, more = np.float32(0.125), np.float32(0.375)
    one, two = np.uint64(1), np.uint64(2)
    for i in range(np.uint64(wide.size - 2)):
        a, b, c, k = wide[i], wide[i + one], wide[i + two], np.uint64(4) * i
        row[k] = far * b + more * a
        row[k + one] = near * b + rest * a
        row[k + two] = near * b + rest * c
        row[k + two + one] = far * b + more * c


@njit_reassoc
def _twos(wide, row):
    near, rest, one, two = np.float32(0.75), np.float32(0.25), np.uint64(1), np.uint64(2)
    for i in range(np.uint64(wide.size - 2)):
        a, b, c, k = wide[i], wide[i + one], wide[i + two], np.uint64(2) * i
        row[k] = near * b + rest * a
        row[k + one] = near * b + rest * c


@njit_reassoc
def _free_row(s, free, scale, out):
    for i in range(s.size):
        out[i] = np.float32(s[i] * scale) if free[i] else np.float32(0)


@njit_reassoc
def _contact_row(free, out):
    for i in range(free.size):
        out[i] = np.float32(0) if free[i] else np.float32(1)


@njit()
def free_in_cells(s, free, scale, coarse, skipped, factors, row):
    """Compute means of ``scale * s`` over coarse cells, in `coarse`.

    Outside the free cells s counts as zero. `factors` are (fy, fx), the numbers of rows and columns of a coarse cell.
    `skipped` is the number of rows of the first coarse row that lie before the rows of this rank. `row` is a work row.
    """
    fy, fx = factors
    coarse[...] = 0
    for j in range(s.shape[0]):
        _free_row(s[j], free[j], scale, row)
        _add_means(row, fx, 1.0 / (fx * fy), coarse[(skipped + j) // fy])


@njit()
def contact_in_cells(free, coarse, skipped, factors, row):
    """Compute the share of contact in each coarse cell, in `coarse`.

    The parameters are as in `free_in_cells`.
    """
    fy, fx = factors
    coarse[...] = 0
    for j in range(free.shape[0]):
        _contact_row(free[j], row)
        _add_means(row, fx, 1.0 / (fx * fy), coarse[(skipped + j) // fy])


@njit_reassoc
def _residual_row(s, free, scale, above, here, below, wx, wy, wd, out):
    for i in range(s.size):
        residual = np.float32(s[i] * scale) - here[i + 1] - stencil_sum(above, here, below, i, wx, wy, wd)
        out[i] = residual if free[i] else np.float32(0)


@njit()
def residual_in_cells(s, free, weights, x, x_before, x_after, coarse, skipped, factors, work, row):
    """Compute coarse-cell means of the residual of x.

    The residual is (s - B3 x) / B3_00 on free cells, where B3 is the 3 x 3 centre of the inverse B of A. `weights` has
    the entries of B3, as in `sweep`. `work` has three work rows. The other parameters are as in `free_in_cells`.
    """
    (scale, wx, wy, wd), (fy, fx) = weights, factors
    coarse[...] = 0
    if not len(x):
        return
    for j in range(-1, len(x) + 1):
        copy_slab_row(len(x_before) + j, x, x_before, x_after, work[j % 3, 1:-1])
        wrap_ends(work[j % 3], row.size, 1)
        if j > 0:
            _residual_row(
                s[j - 1], free[j - 1], scale, work[(j - 2) % 3], work[(j - 1) % 3], work[j % 3], wx, wy, wd, row
            )  # fmt: skip
            _add_means(row, fx, 1.0 / (fx * fy), coarse[(skipped + j - 1) // fy])


@njit()
def _interpolate_row(wide, place, row):
    for i in range(row.size):
        centre = place[0] * i + place[1]
        before = int(np.floor(centre))
        share = np.float32(centre - before)
        row[i] = (np.float32(1) - share) * wide[before + 1] + share * wide[before + 2]


@njit()
def _interpolate_at(t, coarse, places, wide, row):
    """Interpolate coarse rows bilinearly to `row`, a fine row.

    t is the number of the fine row. `places` has the places of rows and columns in the coarse grid, as in `sweep`.
    `wide` is a work row.
    """
    in_y, in_x = places
    centre = in_y[0] * t + in_y[1]
    before = int(np.floor(centre))
    mix_rows(coarse[before], 1 - (centre - before), coarse[before + 1], wide[1:-1])
    wrap_ends(wide, wide.size - 2, 1)
    if in_x[0] == 0.25:
        _fours(wide, row)
    elif in_x[0] == 0.5:
        _twos(wide, row)
    else:
        _interpolate_row(wide, in_x, row)


@njit()
def sweep(
    s, s_before, s_after, free, f_before, f_after, weights, shares, x, x_before, x_after, waves, places, wave_rows, z,
    work,
):  # fmt: skip
    """Make sweeps with the 3 x 3 centre of B on free cells.

    Let B3 be this centre. A sweep is ``x += share (s - B3 x) / B3_00``. The first sweep starts from zero; then the
    given x and the long waves are added.

    Parameters
    ----------
    s : ndarray of float64 or float32, shape (rows, nx)
        Right-hand side.
    free : ndarray of bool, shape (rows, nx)
        Free cells.
    s_before, s_after, f_before, f_after
        Halo rows of s and of `free`; at least as many rows as sweeps, minus one.
    weights : tuple of a float64 and three float32
        First 1 / B3_00, which may be out of range in single precision; then the entries of B3 for neighbours in x, in y
        and on the diagonal, divided by B3_00.
    shares : ndarray of float32
        Step length of each sweep.
    x : ndarray of float32, shape (rows, nx)
        Field that is added after the first sweep, with halo rows like s. It may be z. An empty array means zero.
    waves : ndarray of float64, shape (coarse rows, coarse columns)
        Long waves on these rows and the halo, to be interpolated bilinearly. An empty array means none.
    places : (float, float), (float, float)
        Places of the rows and columns in the coarse grid, as in `Grid.places_in`. Fine rows are counted from the first
        halo row, coarse rows from the first coarse row.
    wave_rows : (ndarray, ndarray) of float32, shapes (coarse columns + 2,), (nx,)
        Work rows.
    z : ndarray of float64 or float32, shape (rows, nx)
        Result: x after the last sweep.
    work : tuple
        Work arrays of `make_work`.
    """
    rows, nx = s.shape
    if not rows:
        return
    steps, (scale, wx, wy, wd) = len(shares), weights
    halo, (sources, inside, swept), (wide, more) = len(s_before), work, wave_rows
    high = rows + 2 * halo
    for t in range(high + steps):
        if t < high:
            k, first = t % (steps + 1), swept[1, t % 3]
            if waves.size:
                _interpolate_at(t, waves, places, wide, more)
            else:
                more[:] = 0
            if x.size:
                copy_slab_row(t, x, x_before, x_after, first[1:-1])
                add_row(more, np.float32(1), first[1:-1])
            _first_at(
                t, s, s_before, s_after, free, f_before, f_after, scale, shares[0], more, sources[k], inside[k],
                first[1:-1],
            )  # fmt: skip
            wrap_ends(first, first.size - 2, 1)
        for m in range(2, steps + 1):
            j = t - m + 1
            if m - 1 <= j < high - m + 1:
                row = swept[m, j % 3]
                _sweep_row(
                    sources[j % (steps + 1)], inside[j % (steps + 1)],
                    swept[m - 1, (j - 1) % 3], swept[m - 1, j % 3], swept[m - 1, (j + 1) % 3],
                    wx, wy, wd, shares[m - 1], row,
                )  # fmt: skip
                wrap_ends(row, row.size - 2, 1)
        j = t - steps + 1
        if halo <= j < halo + rows:
            copy_row(swept[steps, j % 3][1:-1], z[j - halo])


@njit()
def sweep_projected(
    f, f_before, f_after, low, low_before, low_after, room, room_before, room_after, weights, steps, x, work
):  # fmt: skip
    """Make Jacobi sweeps for x, projected onto its bounds.

    A sweep is ``y = f - N x``, then ``x = max(y, min(low, y + room))``. f is the right-hand side divided by B3_00; N
    are the neighbours in the 3 x 3 centre B3 of B, divided by B3_00. x starts from y = f. `low` is the displacement
    that closes the gap. `room` is the displacement by the highest pressure on a cell; None means
    that there is no highest pressure. Arrays are float32. Halos must have at least ``steps - 1`` rows.
    """
    rows, nx = f.shape
    if not rows:
        return
    halo, (_, wx, wy, wd), (sources, lowest, swept, rooms) = len(f_before), weights, work
    high = rows + 2 * halo
    for t in range(high + steps):
        if t < high:
            source, bound, first = sources[t % (steps + 1)], lowest[t % (steps + 1)], swept[1, t % 3]
            copy_slab_row(t, f, f_before, f_after, source)
            copy_slab_row(t, low, low_before, low_after, bound)
            if room is not None:
                copy_slab_row(t, room, room_before, room_after, rooms[t % (steps + 1)])
            _first_clipped_row(source, bound, _row_of(rooms, t % (steps + 1)), first[1:-1])
            wrap_ends(first, first.size - 2, 1)
        for m in range(2, steps + 1):
            j = t - m + 1
            if m - 1 <= j < high - m + 1:
                row, k = swept[m, j % 3], j % (steps + 1)
                above, here, below = swept[m - 1, (j - 1) % 3], swept[m - 1, j % 3], swept[m - 1, (j + 1) % 3]
                _clipped_row(sources[k], lowest[k], _row_of(rooms, k), above, here, below, wx, wy, wd, row)
                wrap_ends(row, row.size - 2, 1)
        j = t - steps + 1
        if halo <= j < halo + rows:
            copy_row(swept[steps, j % 3][1:-1], x[j - halo])


@njit_reassoc
def _add_row(above, here, below, scale, wx, wy, wd, out):
    for i in range(out.size):
        neighbours = stencil_sum(above, here, below, i, wx, wy, wd)
        out[i] += scale * (here[i + 1] + neighbours)


@njit()
def add_centre(d, before, after, weights, work, out):
    """Add the 3 x 3 centre of B times d to `out`.

    `before` and `after` are the halo of d, one row each; `weights` has the entries of the centre, as in `sweep`.
    """
    scale, wx, wy, wd = 1.0 / weights[0], weights[1], weights[2], weights[3]
    if not len(d):
        return
    for j in range(-1, len(d) + 1):
        row = work[j % 3]
        copy_slab_row(len(before) + j, d, before, after, row[1:-1])
        wrap_ends(row, row.size - 2, 1)
        if j > 0:
            _add_row(work[(j - 2) % 3], work[(j - 1) % 3], row, scale, wx, wy, wd, out[j - 1])


def make_work(steps, nx):
    """Return the work arrays of `sweep` for a number of sweeps."""
    sources, swept = np.empty((steps + 1, nx), np.float32), np.zeros((steps + 1, 3, nx + 2), np.float32)
    return sources, np.empty((steps + 1, nx), bool), swept


def make_projected_work(steps, nx, room):
    """Return the work arrays of `sweep_projected`, with or without a `room`."""
    sources, _, swept = make_work(steps, nx)
    return sources, np.empty_like(sources), swept, None if room is None else np.empty_like(sources)
