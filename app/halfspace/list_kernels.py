"""Compiled loops of products between lists of cells.

Cells are stored in aligned segments of eight cells of a row. So inner loops have no branches, and eight sums stay in
one vector register.
"""

from numba.extending import overload

from app.base.numba_cache import njit

SEGMENT = 8  # cells
_FASTMATH = {"reassoc", "contract", "nsz"}


def add_products(sums, p, table):
    """Return the sums of eight cells plus products with eight pressures, in compiled code."""
    raise NotImplementedError


@overload(add_products)
def _add_products(sums, p, table):
    cells = range(SEGMENT)
    products = [[f"p[{i}] * table[{SEGMENT - 1 + j - i}]" for i in cells] for j in cells]
    entries = "".join(f"sums[{j}] + {' + '.join(products[j])}, " for j in cells)
    # Constant indices: numba would test for negative ones, and LLVM would not use vectors.
    return eval(f"lambda sums, p, table: ({entries})")


@njit(fastmath=_FASTMATH)
def sum_local(rows, starts, columns, source_starts, source_columns, p, table, reach, first, u):
    """Add the sums of a table times the pressures of near cells.

    Parameters
    ----------
    rows : ndarray of int
        Rows with targets.
    starts, source_starts : ndarray of int, shape (ny + 1,)
        First segment of each row, of targets and of sources.
    columns, source_columns : ndarray of int
        Position of each segment in its row, in segments.
    p, u : ndarray
        Pressures and sums, eight for each segment. p is 0 in cells that are not listed.
    table : ndarray, shape (offsets, 2 centre + 1)
        Coefficients at offsets in y, from 0 on, and in x, from -centre on.
    reach : ndarray of int, shape (offsets,)
        Offset in x of the farthest segments to sum [segments].
    first : ndarray of int, shape (2 offsets - 1,)
        Work array.
    """
    ny, offsets, centre = len(starts) - 1, len(table), table.shape[1] // 2
    for y in rows:
        low, high = max(0, y - offsets + 1), min(ny, y + offsets)
        for row in range(low, high):
            first[row - low] = source_starts[row]
        for k in range(starts[y], starts[y + 1]):
            sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for row in range(low, high):
                offset = abs(row - y)
                m, stop = first[row - low], source_starts[row + 1]
                west, east = columns[k] - reach[offset], columns[k] + reach[offset]
                while m < stop and source_columns[m] < west:
                    m += 1
                first[row - low] = m
                while m < stop and source_columns[m] <= east:
                    place = centre + SEGMENT * (columns[k] - source_columns[m])
                    segment = p[SEGMENT * m : SEGMENT * (m + 1)]
                    sums = add_products(sums, segment, table[offset][place - SEGMENT + 1 : place + SEGMENT])
                    m += 1
            own = u[SEGMENT * k : SEGMENT * (k + 1)]
            for i, value in enumerate(sums):
                own[i] += value


@njit(fastmath=_FASTMATH)
def spread(ix, iy, p, in_x, in_y, sums, nodes):
    """Add the pressures of cells (ix, iy) to the nodes around each cell.

    `in_x` and `in_y` are the weights of nodes, shape (cells between nodes, nodes). Cells of a row between the same
    nodes are added in x first, to the work array `sums`, shape (nodes,).
    """
    count, n = len(ix), 0
    while n < count:
        x, y = ix[n] // len(in_x), iy[n] // len(in_y)
        weights = in_y[iy[n] - y * len(in_y)]
        sums[:] = 0.0
        row, end = iy[n], (x + 1) * len(in_x)
        while n < count and iy[n] == row and ix[n] < end:
            value, others = p[n], in_x[ix[n] - x * len(in_x)]
            for i in range(len(sums)):
                sums[i] += value * others[i]
            n += 1
        for j in range(len(weights)):
            value, near = weights[j], nodes[y + j][x : x + len(sums)]
            for i in range(len(sums)):
                near[i] += value * sums[i]


@njit(fastmath=_FASTMATH)
def gather(ix, iy, nodes, in_x, in_y, sums, u):
    """Add weighted sums of the nodes around each cell to u; see `spread`."""
    count, n = len(ix), 0
    while n < count:
        x, y = ix[n] // len(in_x), iy[n] // len(in_y)
        weights = in_y[iy[n] - y * len(in_y)]
        sums[:] = 0.0
        for j in range(len(weights)):
            value, near = weights[j], nodes[y + j][x : x + len(sums)]
            for i in range(len(sums)):
                sums[i] += value * near[i]
        row, end = iy[n], (x + 1) * len(in_x)
        while n < count and iy[n] == row and ix[n] < end:
            total, others = 0.0, in_x[ix[n] - x * len(in_x)]
            for i in range(len(sums)):
                total += sums[i] * others[i]
            u[n] += total
            n += 1
