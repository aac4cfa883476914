"""Areal Gaussian filters (ISO 16610-61 and 25178).

A filter of nesting index (cut-off wavelength) c has the weights exp(-pi (r/(alpha c))^2) at a distance r, with
alpha = sqrt(ln 2/pi). It multiplies a wave of length l by 2^-(c/l)^2, so by one half at l = c.

On a patch that is not periodic, a plane is fitted to the heights around each point by least squares with these weights.
This is Gaussian regression of order one (ISO 16610-31 and -71). Far from the patch boundary and from missing points,
the plane's value at the point is the weighted mean of the heights. Near the boundary and missing points, the filter
leaves planes unchanged, as with the retained moments of ISO 16610-28. On a periodic patch, which has no boundary, the
filter takes the weighted mean of the known heights (order zero).
"""

import numpy as np

from app.base.errors import InputError, format_exact, is_number
from app.base.memory import check_fits
from app.base.units import format_lengths
from app.halfspace.grid import repeats_in

REACH = 1.25  # of the weights, in nesting indices; farther weights are below 3e-10 of the largest
RUN = 1 << 18  # numbers that are transformed together
MIN_SPREAD = 1e-10  # variance of weighted points, in squared widths; less is rounding of points on a line


def check_order(s_filter, l_filter):
    """Raise InputError unless both nesting indices are valid and in order.

    `s_filter` must be below `l_filter`.
    """
    for name, index in (("s", s_filter), ("l", l_filter)):
        if index is not None and not (is_number(index) and 0 < index < np.inf):
            raise InputError(f"surface {name}_filter {index!r}: must be a positive wavelength [mm]")
    if s_filter and l_filter and s_filter >= l_filter:
        raise InputError(
            f"surface s_filter {format_exact(s_filter)} and l_filter {format_exact(l_filter)}: leave no waves "
            "between them; the S-filter's wavelength, that of noise, must be below the L-filter's, "
            "that of waviness [mm]"
        )


def check_cells(file, s_filter, l_filter, shape, cell):
    """Raise InputError for nesting indices out of range.

    A nesting index must be at least two cells and at most the shorter side. A direction of one cell does not count,
    because nothing is filtered in it. `shape` is (ny, nx); `cell` is (dx, dy) [mm]. If `cell` is None (unknown),
    InputError is raised, too.
    """
    if s_filter is l_filter is None:
        return
    if cell is None:
        raise InputError(
            f"spacing= of read_surface is missing: surface file {file} does not say its spacing, which filters need; "
            "or filter by Surface.filtered, on a grid"
        )
    sides = [(n, width) for n, width in zip(shape[::-1], cell, strict=True) if n > 1]
    if not sides:
        raise InputError(f"surface file {file}: is one cell: nothing to filter")
    least, most = 2 * max(width for _, width in sides), min(n * width for n, width in sides)
    for name, index in (("s", s_filter), ("l", l_filter)):
        if index is not None and not least * (1 - 1e-9) <= index <= most * (1 + 1e-9):
            raise InputError(
                f"surface {name}_filter {format_exact(index)} mm: must be {format_exact(least)} to "
                f"{format_exact(most)} mm for surface file {file}, from two of its cells ({format_lengths(*cell)}) "
                "to its shorter side"
            )


def band_pass(heights, s_filter, l_filter, cell, periodic=False):
    """Remove waves shorter than the S-filter and longer than the L-filter.

    `heights`, of shape (ny, nx), are overwritten; NaN entries have no weight and stay NaN. The nesting indices (cut-off
    wavelengths) `s_filter` and `l_filter` have the unit of `cell`, (dx, dy); None means no filter. If `periodic`, the
    filter continues across the sides of the map; "x" or "y": across the sides in this direction only.

    Examples
    --------
    >>> wave = np.cos(2 * np.pi * np.arange(40) / 20)[None, :]
    >>> rest = band_pass(wave.copy(), None, 20.0, (1.0, 1.0), periodic=True)
    >>> bool(np.allclose(rest, wave / 2))
    True
    """
    check_fits(80.0 * heights.size, f"a filter of {heights.shape[1]} x {heights.shape[0]} heights")
    if s_filter:
        heights = _low_pass(heights, s_filter, cell, periodic)
    if l_filter:
        heights -= _low_pass(heights.copy(), l_filter, cell, periodic)
    return heights


def _low_pass(heights, index, cell, periodic):
    """Smooth heights in place by a Gaussian filter.

    `index` is the nesting index (cut-off wavelength), in the unit of `cell`. Sums are taken along rows first, then
    along columns.
    """
    repeats = repeats_in(periodic)
    missing = np.isnan(heights)
    middle = np.mean(heights, where=~missing)  # large offsets would cost digits
    heights -= middle
    heights[missing] = 0.0
    ny, nx = heights.shape

    def smoothed(values, axis, power):
        values = values.copy()
        if heights.shape[axis] > 1:
            _smooth(values, axis, index / cell[1 - axis], repeats[axis], power)
        elif power:
            values[...] = 0.0
        return values

    powers = range(1 if all(repeats) else 3)
    # Without missing points all rows have the same weights: sums of weights are products.
    known = 1.0 - missing if missing.any() else np.ones((1, nx))
    weights, sums = [smoothed(known, 1, i) for i in powers], [smoothed(heights, 1, i) for i in powers[:2]]
    column = [smoothed(np.ones((ny, 1)), 0, j) for j in powers]
    width = max(1, RUN // ny)
    for start in range(0, nx, width):

        def moment(rows, i, j, columns=slice(start, start + width)):
            """Return weighted sums of distances x^i y^j."""
            values = rows[i][:, columns]
            return column[j] * values if len(values) == 1 else smoothed(values, 0, j)

        heights[:, start : start + width] = _fit(moment, weights, sums, all(repeats))
    heights[missing] = np.nan
    heights += middle
    return heights


def _fit(moment, weights, sums, periodic):
    """Fit a plane around each point; return its height at the point.

    If `periodic`, return weighted means instead. The function ``moment(values, i, j)`` returns filtered sums of
    `values` times x^i y^j around each point, with the distances x and y from the point. `sums` are the heights times
    their `weights`.
    """
    weight = moment(weights, 0, 0)
    with np.errstate(all="ignore"):  # far from all points
        mean = moment(sums, 0, 0) / weight
        if periodic:
            return mean
        dx, dy = moment(weights, 1, 0) / weight, moment(weights, 0, 1) / weight
        centres = dx * dx, dx * dy, dy * dy
        xx, xy, yy = (moment(weights, 2 - j, j) / weight - centres[j] for j in range(3))
        x, y = moment(sums, 1, 0) / weight - dx * mean, moment(sums, 0, 1) / weight - dy * mean

        def slope(product, square):
            return np.divide(product, square, out=np.zeros_like(weight), where=square * weight > MIN_SPREAD)

        turn = slope(xy, xx)
        return mean - dx * slope(x, xx) - (dy - turn * dx) * slope(y - turn * x, yy - turn * xy)


def _smooth(values, axis, cells, periodic, power=0):
    """Convolve values along an axis with filter weights.

    `cells` is the nesting index in cells. The weights are multiplied by (distance / width)^`power`, with the signed
    distance and the filter's width alpha c.
    """
    from scipy.fft import irfft, next_fast_len, rfft  # loads slowly

    n, width = values.shape[axis], cells * np.sqrt(np.log(2) / np.pi)
    reach = int(np.ceil(REACH * cells))
    if not periodic:
        reach = min(reach, n - 1)
    size = n if periodic else next_fast_len(n + reach, real=True)
    places = np.arange(-reach, reach + 1)
    weights = np.exp(-np.pi * (places / width) ** 2)
    weights *= (places / width) ** power / weights.sum()
    passed = rfft(np.bincount(places % size, weights, minlength=size))  # adds up periodic images
    run = max(1, RUN // size)
    lines = np.moveaxis(values, axis, 1)
    for start in range(0, len(lines), run):
        part = lines[start : start + run]
        part[...] = irfft(rfft(part, size) * passed, size)[:, :n]
