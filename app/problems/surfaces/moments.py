"""Moments of a height map: level, tilt, roughness."""

from operator import itemgetter

import numpy as np

from app.base.errors import InputError, format_exact
from app.options.option_table import LARGEST

LEVELS = {"none": (), "mean": ((0, 0),)}  # powers (k, m) of the terms x^k y^m that are subtracted
LEVELS["plane"] = (*LEVELS["mean"], (1, 0), (0, 1))
LEVELS["quadratic"] = (*LEVELS["plane"], (2, 0), (1, 1), (0, 2))
RUN = 1 << 18  # cells that are read together
# Rounding of heights over their range (six digits), plus that over the largest height (single precision).
ROUNDING = 1e-6, 2.0**-24
MIN_POINTS = 8  # known points of a row; fewer may have the same height by chance
MIN_DEPTH = 2.0  # of an unmeasured row, in rms heights below the best plane of all other rows


def cell_centres(n):
    """Return n cell centres between -1 and 1."""
    return (2 * np.arange(n) + 1) / n - 1


def add_polynomial(z, coefficients, start, ny, sign=1):
    """Add `sign` times a polynomial in x and y to rows z.

    z are the rows from `start` on of a map of `ny` rows. x and y go from -1 to 1 over the map. `coefficients` maps
    powers (k, m) to the factor of x^k y^m.
    """
    x, y = cell_centres(z.shape[1]), cell_centres(ny)[start : start + len(z)]
    for (k, m), coefficient in coefficients.items():
        z += sign * coefficient * x**k * y[:, None] ** m
    return z


class Moments:
    """Sums over the known heights of a map.

    The sums are of x^k y^m and z x^k y^m over the heights z, where x and y go from -1 to 1. A step is the difference of
    neighbouring heights in x or y; there are also the sums of steps and of squared steps. The function ``rows(start,
    stop)`` returns a new array of heights [mm], NaN where missing. Infinite or too large heights, and a map without any
    height, raise InputError.
    """

    def __init__(self, name, rows, shape):
        self.powers, self.products, self.squares = np.zeros((5, 5)), np.zeros((3, 3)), 0.0
        self._name, self._rows, self.shape, self.reference = name, rows, shape, None
        self._steps = np.zeros((2, 3))  # in x, y: number, sum, sum of squares
        ny, nx = shape
        self._run = max(1, RUN // nx)
        # Lowest and highest height, and number of known ones, in each row and column.
        self._in_rows, self._in_columns = np.full((3, ny), np.nan), np.full((3, nx), np.nan)
        x, y, last = cell_centres(nx), cell_centres(ny), np.full((1, nx), np.nan)
        for start in range(0, ny, self._run):
            z = rows(start, min(start + self._run, ny))
            self._add(z, x, y[start : start + self._run], start)
            in_x, in_y = np.diff(z), np.diff(np.vstack([last, z]), axis=0)
            for sums, steps in zip(self._steps, (in_x, in_y), strict=True):
                steps = steps[np.isfinite(steps)]
                sums += steps.size, steps.sum(), steps @ steps
            last = z[-1:]
        if not self.count:
            raise InputError(f"surface file {name}: all points are missing (NaN)")

    def _add(self, z, x, y, first):
        known = ~np.isnan(z)
        if not known.any():
            return
        large = np.argwhere(known & ~(np.abs(z) < LARGEST))
        if len(large):
            j, i = large[0]
            raise InputError(
                f"surface file {self._name}: {format_exact(z[j, i])} mm in row {first + j}, column {i}; must be "
                "numbers, and NaN for missing points"
            )
        if self.reference is None:
            self.reference = z[known][0]  # large offsets would cost digits
        _add_extremes(self._in_rows[:, first : first + len(z)], z, known, 1)
        _add_extremes(self._in_columns, z, known, 0)
        z = np.where(known, z - self.reference, 0.0)
        in_x, in_y = (np.stack([values**k for k in range(5)]) for values in (x, y))
        self.powers += in_x @ known.T.astype(float) @ in_y.T
        self.products += in_x[:3] @ z.T @ in_y[:3].T
        self.squares += float(np.einsum("ji,ji", z, z))

    @property
    def count(self):
        """Number of known heights."""
        return self.powers[0, 0]

    @property
    def rounding(self):
        """Largest height difference that may be rounding only [mm]."""
        low, high = np.nanmin(self._in_rows[0]), np.nanmax(self._in_rows[1])
        return float(np.dot(ROUNDING, (high - low, max(high, -low))))

    @property
    def steps(self):
        """Rms height differences of neighbouring points, in x and in y [mm].

        The best plane is subtracted first.
        """
        _, *tilt = self._solve(LEVELS["plane"])
        count, total, squares = self._steps.T
        plane = 2 * np.array(tilt) / self.shape[::-1]
        with np.errstate(invalid="ignore"):
            mean = (squares - 2 * plane * total) / count + plane**2
        return tuple(float(step) for step in np.sqrt(np.maximum(mean, 0.0)))

    def tilt(self):
        """Return the rise of the best plane, and the rms height about it."""
        plane = self._solve(LEVELS["plane"])
        return float(2 * (abs(plane[1]) + abs(plane[2]))), self._rms_about("plane")

    def slopes(self):
        """Return the slopes of the best plane in x and y [mm].

        x and y go from -1 to 1 over the map.
        """
        return {term: slope for term, slope in self.fit("plane").items() if sum(term)}

    def unmeasured(self):
        """Find rows and columns that were probably not measured.

        All points of an unmeasured row have the lowest height of the map, far below the best plane of the other points.
        Return a list of tuples: "row" or "column", the numbers of these rows or columns, and by how much they move the
        best plane [mm].
        """
        unmeasured, lowest = [], np.nanmin(self._in_rows[0])
        for k, (low, high, known) in enumerate((self._in_rows, self._in_columns)):
            lines = (low == lowest) & (high == lowest) & (known >= max(MIN_POINTS, self.shape[1 - k] / 2))
            others = (known > 0) & ~lines
            # Heights that vary in one direction only have such rows, too.
            if not lines.any() or 2 * np.count_nonzero((low < high)[others]) <= np.count_nonzero(others):
                continue

            def measured(start, stop, k=k, lines=lines):
                left_out = lines[None, :] if k else lines[start:stop, None]
                return np.where(left_out, np.nan, self._rows(start, stop))

            rest = Moments(self._name, measured, self.shape)
            plane, whole = rest.fit("plane"), self.fit("plane")
            depth = plane[0, 0] + cell_centres(len(lines))[lines] * plane[(1, 0) if k else (0, 1)] - lowest
            if depth.max() > MIN_DEPTH * rest.tilt()[1]:
                shift = sum(abs(plane[term] - whole[term]) for term in plane)
                unmeasured.append((("row", "column")[k], np.flatnonzero(lines), shift))
        return unmeasured

    def roughness(self, level):
        """Return `Surface` attributes from `rms_height` to `spike`, by name.

        All heights are read a second time. ``rms_height`` refers to heights after subtraction of the `level`. All other
        numbers refer to heights above the best plane, or the best quadratic if the level is "quadratic".
        """
        if level == "quadratic":
            bowl = self.fit(level)

            def levelled(start, stop):
                return add_polynomial(self._rows(start, stop), bowl, start, self.shape[0], sign=-1)

            return Moments(self._name, levelled, self.shape).roughness("none")
        plane, sums, ny = self.fit("plane"), np.zeros(3), self.shape[0]
        rms, steps, spike = self._rms_about("plane"), self.steps, (0.0, 0, 0)
        for start in range(0, ny, self._run):
            stop, first = min(start + self._run, ny), max(start - 1, 0)
            z = add_polynomial(self._rows(first, min(stop + 1, ny)), plane, first, ny, sign=-1)
            run = slice(start - first, stop - first)
            height, row, column = _find_spike(z, run)
            spike = max(spike, (height, start + row, column), key=itemgetter(0))
            z = np.nan_to_num(z[run])
            z /= rms or 1.0
            square = z * z
            sums += [np.sum(square), np.vdot(square, z), np.vdot(square, square)]
        square, cube, fourth = sums / self.count
        step = max((step for step in steps if step > 0), default=np.inf)
        return {
            "rms_height": self._rms_about(level),
            "rms_level": rms,
            "skewness": float(cube / square**1.5) if square else np.nan,
            "kurtosis": float(fourth / square**2) if square else np.nan,
            "steps": steps,
            "spike": (spike[0], spike[0] / step, *spike[1:]),
        }

    def fit(self, level):
        """Return the polynomial of a level that fits the heights best [mm].

        The returned dict maps powers (k, m) to the factor of x^k y^m.
        """
        terms = LEVELS[level]
        coefficients = dict(zip(terms, map(float, self._solve(terms)), strict=True))
        if terms:
            coefficients[0, 0] += self.reference
        return coefficients

    def _solve(self, terms):
        if not terms:
            return np.zeros(0)
        gram = np.array([[self.powers[k + p, m + q] for p, q in terms] for k, m in terms])
        right = np.array([self.products[k, m] for k, m in terms])
        # About the means: a single row of points has no slope across it.
        means, height = gram[0] / self.count, right[0] / self.count
        gram, right = gram - np.outer(gram[0], means), right - gram[0] * height
        coefficients = np.linalg.lstsq(gram, right, rcond=1e-12)[0]
        coefficients[0] = height - means[1:] @ coefficients[1:]
        return coefficients

    def _rms_about(self, level):
        terms = LEVELS[level] or LEVELS["mean"]
        right = np.array([self.products[k, m] for k, m in terms])
        return float(np.sqrt(max(self.squares - right @ self._solve(terms), 0.0) / self.count))


def _add_extremes(extremes, z, known, axis):
    """Update lowest, highest, and number of known heights.

    `extremes` has these three numbers for each row of z if `axis` is 1, for each column if `axis` is 0.
    """
    low, high, count = extremes
    np.fmin(low, np.fmin.reduce(z, axis=axis), out=low)
    np.fmax(high, np.fmax.reduce(z, axis=axis), out=high)
    count[...] = np.nan_to_num(count) + np.count_nonzero(known, axis=axis)


def _find_spike(z, run):
    """Find the point highest above its four neighbours.

    Only points in the rows `run` (a slice) of z count. Return the point's height above the highest neighbour (0 if no
    point stands out), the row within `run`, and the column.
    """
    padded = np.pad(z, 1, constant_values=np.nan)
    highest = np.fmax.reduce([padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2]])
    above = np.nan_to_num((z - highest)[run])
    j, i = np.unravel_index(above.argmax(), above.shape)
    return max(float(above[j, i]), 0.0), int(j), int(i)
