"""Compiled loops of products between lists of cells.

Cells are stored in aligned segments of eight cells of a row. So inner loops have no branches, and eight sums stay in
one vector register.
"""

from numba.extending import overload

from app.base.numba_cache import njit

SEGMENT = 8  # cells
BAND = 8  # rows
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
def sum_local(rows, columns, starts, source_rows, source_columns, source_starts, p, table, reach, near, u):
    """Add the sums of a table times the pressures of near cells.

    The targets of a band of rows with the same columns have the same list of near sources, so their loops are long and
    have no branches.

    Parameters
    ----------
    rows, columns : ndarray of int
        Rows of the target segments, and positions in a row [segments], sorted by band, column and row.
    starts : ndarray of int, shape (bands + 1,)
        First target segment of each band.
    source_rows, source_columns, source_starts : ndarray of int
        The same for sources.
    p, u : ndarray
        Pressures and sums, eight for each segment. p is 0 in cells that are not listed.
    table : ndarray, shape (offsets, 2 centre + 1)
        Coefficients at offsets in y, from 0 on, and in x, from -centre on.
    reach : ndarray of int
        Largest offset in x by the offset in bands [segments].
    near : ndarray of int, shape (sources,)
        Work array.
    """
    bands, centre, k = len(starts) - 1, table.shape[1] // 2, 0
    while k < len(rows):
        column, band, end = columns[k], rows[k] // BAND, k
        while end < starts[band + 1] and columns[end] == column:
            end += 1
        count = 0
        for other in range(max(0, band - len(reach) + 1), min(bands, band + len(reach))):
            most = reach[abs(other - band)]
            m = _first_from(source_columns, column - most, source_starts[other], source_starts[other + 1])
            while m < source_starts[other + 1] and source_columns[m] <= column + most:
                near[count] = m
                count += 1
                m += 1
        while k < end:
            sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for n in range(count):
                m = near[n]
                place = centre + SEGMENT * (column - source_columns[m])
                coefficients = table[abs(rows[k] - source_rows[m])][place - SEGMENT + 1 : place + SEGMENT]
                sums = add_products(sums, p[SEGMENT * m : SEGMENT * (m + 1)], coefficients)
            own = u[SEGMENT * k : SEGMENT * (k + 1)]
            for i, value in enumerate(sums):
                own[i] += value
            k += 1


@njit()
def _first_from(columns, column, low, high):
    """Return the first position between two positions from which on sorted columns are at least `column`."""
    while low < high:
        middle = (low + high) // 2
        if columns[middle] < column:
            low = middle + 1
        else:
            high = middle
    return low


@njit(fastmath=_FASTMATH)
def sum_arms(starts, places, source_starts, source_places, p, table, first, last, u):
    """Add the sums of a table times the pressures in the same and in near lines of a periodic patch.

    Parameters
    ----------
    starts, source_starts : ndarray of int, shape (lines of the patch + 1,)
        First target and first source of each line (row or column).
    places, source_places : ndarray of int
        Positions in their lines, sorted. Copies of the sources continue each line by half a period on both sides.
    p, u : ndarray
        Pressures of the sources, and sums at the targets.
    table : ndarray, shape (near lines, offsets)
        Coefficients at offsets in lines, from 0 on, and along a line.
    first, last : ndarray of int, shape (near lines,)
        Least and largest offsets along a line of coefficients that are not zero; `first` is positive.
    """
    lines = len(starts) - 1
    for line in range(lines):
        if starts[line] == starts[line + 1]:
            continue
        for j in range(1 - len(table), len(table)):
            other, row = (line + j) % lines, table[abs(j)]
            near, far, end = first[abs(j)], last[abs(j)], source_starts[other + 1]
            if source_starts[other] == end:
                continue
            a = b = c = d = source_starts[other]
            for k in range(starts[line], starts[line + 1]):
                place, total = places[k], 0.0
                while a < end and source_places[a] < place - far:
                    a += 1
                while b < end and source_places[b] <= place - near:
                    b += 1
                while c < end and source_places[c] < place + near:
                    c += 1
                while d < end and source_places[d] <= place + far:
                    d += 1
                for m in range(a, b):
                    total += p[m] * row[place - source_places[m]]
                for m in range(c, d):
                    total += p[m] * row[source_places[m] - place]
                u[k] += total


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
def sum_on_rows(ix, iy, p, table, first, u):
    """Add the sums of a table times pressures of near cells (ix, iy) to u on rows, from row `first` on.

    `table` is as in `sum_local`.
    """
    rows, nx = u.shape
    last, centre = len(table) - 1, table.shape[1] // 2
    for n in range(len(ix)):
        left, right, value = max(ix[n] - centre, 0), min(ix[n] + centre + 1, nx), p[n]
        start = left - ix[n] + centre
        for y in range(max(iy[n] - last - first, 0), min(iy[n] + last + 1 - first, rows)):
            near, others = u[y][left:right], table[abs(first + y - iy[n])][start:]
            for i in range(len(near)):
                near[i] += value * others[i]


@njit(fastmath=_FASTMATH)
def gather_on_rows(first, nodes, in_x, in_y, lines, u):
    """Store weighted sums of the nodes around each cell in u, on rows from row `first` on; see `spread`.

    `lines` is a work array, shape (nodes, nx): the last rows of nodes, with the weights in x.
    """
    window, (rows, nx) = len(lines), u.shape
    ready = first // len(in_y)  # rows of nodes before this one are not needed
    for j in range(rows):
        y = (first + j) // len(in_y)
        for k in range(max(ready, y), y + window):
            line, row = lines[k % window], nodes[k]
            for i in range(nx):
                x, total = i // len(in_x), 0.0
                others, near = in_x[i - x * len(in_x)], row[x : x + window]
                for m in range(window):
                    total += near[m] * others[m]
                line[i] = total
        ready, weights, out = y + window, in_y[first + j - y * len(in_y)], u[j]
        out[:] = 0.0
        for k in range(window):
            value, line = weights[k], lines[(y + k) % window]
            for i in range(nx):
                out[i] += value * line[i]


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
