"""Sums over a height map, which is looked at once, a run of rows after the other: level, tilt, rms height and slope."""

from __future__ import annotations

from operator import itemgetter

import numpy as np

from app.base.errors import InputError, format_exact
from app.options.option_table import LARGEST

LEVELS = {"none": (), "mean": ((0, 0),)}
LEVELS["plane"] = (*LEVELS["mean"], (1, 0), (0, 1))
LEVELS["quadratic"] = (*LEVELS["plane"], (2, 0), (1, 1), (0, 2))  # powers of x and y that are taken off
_RUN = 1 << 18  # cells that are looked at together
# Heights that differ by less may differ by rounding only: share of their range, as of six digits, and of the largest
# one, as of single precision.
_ROUNDING = 1e-6, 2.0**-24
_FEW_POINTS = 8  # of a row, fewer of which may have the same height by chance
_FAR_BELOW = 2.0  # rms heights below the best plane of all other rows, where a row was probably not measured


def centred(n):
    """Cell centres of n cells between -1 and 1. Not collective."""
    return (2 * np.arange(n) + 1) / n - 1


def take_off(coefficients, z, start, ny):
    """Take a polynomial of x and y, as of `Moments.fit`, off rows from `start` on of ny, in place. Not collective."""
    x, y = centred(z.shape[1]), centred(ny)[start : start + len(z)]
    for (k, m), coefficient in coefficients.items():
        z -= coefficient * x**k * y[:, None] ** m
    return z


class Moments:
    """Sums over the heights z that are there: of x^k y^m, of z x^k y^m, of steps; x and y go from -1 to 1 [mm].

    Not collective.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    rows : callable
        ``rows(start, stop)`` gives rows of heights, NaN where missing, in an array of their own [mm].
    shape : tuple of int
        ny, nx.

    Raises
    ------
    InputError
        If a height is of no use, or all are missing.
    """

    def __init__(self, name, rows, shape):
        self.powers, self.products, self.squares = np.zeros((5, 5)), np.zeros((3, 3)), 0.0
        self._name, self._rows, self.shape, self.reference = name, rows, shape, None
        self._steps = np.zeros((2, 3))  # along x, y: how many, their sum and that of their squares
        ny, nx = shape
        self._in_rows, self._in_columns = np.full((3, ny), np.nan), np.full((3, nx), np.nan)
        x, y, run, last = centred(nx), centred(ny), self._run, np.full((1, nx), np.nan)
        for start in range(0, ny, run):
            z = rows(start, min(start + run, ny))
            self._add(z, x, y[start : start + run], start)
            self._add_steps(0, np.diff(z, axis=1))
            self._add_steps(1, np.diff(np.vstack([last, z]), axis=0))
            last = z[-1:]
        if not self.count:
            raise InputError(f"surface file {name}: all points are missing (NaN)")

    @property
    def _run(self):
        """Rows that are looked at together."""
        return max(1, _RUN // self.shape[1])

    def _add(self, z, x, y, first):
        there = ~np.isnan(z)
        if not there.any():
            return
        large = np.argwhere(there & ~(np.abs(z) < LARGEST))
        if len(large):
            j, i = large[0]
            raise InputError(
                f"surface file {self._name}: {format_exact(z[j, i])} mm in row {first + j}, column {i}; allowed: "
                "numbers, and NaN for missing points"
            )
        if self.reference is None:
            self.reference = z[there][0]  # so that large offsets cost no digits
        _widen(self._in_rows[:, first : first + len(z)], z, there, 1)
        _widen(self._in_columns, z, there, 0)
        z = np.where(there, z - self.reference, 0.0)
        in_x, in_y = (np.stack([values**k for k in range(5)]) for values in (x, y))
        self.powers += in_x @ there.T.astype(float) @ in_y.T
        self.products += in_x[:3] @ z.T @ in_y[:3].T
        self.squares += float(np.einsum("ji,ji", z, z))

    def _add_steps(self, along, steps):
        known = steps[np.isfinite(steps)]
        self._steps[along] += known.size, known.sum(), known @ known

    @property
    def count(self):
        """Points that are there."""
        return self.powers[0, 0]

    @property
    def rounding(self):
        """Height below which differences may be rounding only [mm]."""
        low, high = np.nanmin(self._in_rows[0]), np.nanmax(self._in_rows[1])
        return float(np.dot(_ROUNDING, (high - low, max(high, -low))))

    @property
    def steps(self):
        """Root mean square of the steps from cell to cell in x and in y, about the best plane's [mm]; NaN: none."""
        _, *tilt = self._solve(LEVELS["plane"])
        count, total, squares = self._steps.T
        plane = 2 * np.array(tilt) / self.shape[::-1]
        with np.errstate(invalid="ignore"):
            mean = (squares - 2 * plane * total) / count + plane**2
        return tuple(float(step) for step in np.sqrt(np.maximum(mean, 0.0)))

    def tilt(self):
        """Rise of the best plane from side to side, and the standard deviation about it [mm]."""
        plane = self._solve(LEVELS["plane"])
        return float(2 * (abs(plane[1]) + abs(plane[2]))), self._rms_about("plane")

    def slopes(self):
        """Coefficients of the best plane but the constant."""
        return {term: slope for term, slope in self.fit("plane").items() if sum(term)}

    def unmeasured(self):
        """Find rows and columns whose points all have the lowest height, far below the plane of the others.

        Returns
        -------
        list of tuple
            "row" or "column", their numbers, and by how much they move the best plane [mm].
        """
        found, lowest = [], np.nanmin(self._in_rows[0])
        for k, (low, high, known) in enumerate((self._in_rows, self._in_columns)):
            lines = (low == lowest) & (high == lowest) & (known >= max(_FEW_POINTS, self.shape[1 - k] / 2))
            others = (known > 0) & ~lines
            if not lines.any() or 2 * np.count_nonzero(low[others] < high[others]) <= np.count_nonzero(
                others
            ):
                continue  # heights that vary in one direction only have such rows, too

            def measured(start, stop, k=k, lines=lines):
                left_out = lines[None, :] if k else lines[start:stop, None]
                return np.where(left_out, np.nan, self._rows(start, stop))

            rest = Moments(self._name, measured, self.shape)
            plane, whole = (moments.fit("plane") for moments in (rest, self))
            above = plane[0, 0] + centred(len(lines))[lines] * plane[(1, 0) if k else (0, 1)] - lowest
            if above.max() > _FAR_BELOW * rest.tilt()[1]:
                moved = sum(abs(plane[term] - whole[term]) for term in plane)
                found.append((("row", "column")[k], np.flatnonzero(lines), moved))
        return found

    def roughness(self, level):
        """What a `Surface` says of its heights, by name, by a second look at all of them.

        All but the rms height is about the best plane, or about level "quadratic", which leaves what is pressed.
        """
        if level == "quadratic":

            def left(start, stop):
                return take_off(bowl, self._rows(start, stop), start, self.shape[0])

            bowl = self.fit(level)
            return Moments(self._name, left, self.shape).roughness("none")
        plane, sums, ny = self.fit("plane"), np.zeros(3), self.shape[0]
        rms, steps, spike = self._rms_about("plane"), self.steps, (0.0, 0, 0)
        for start in range(0, ny, self._run):
            stop, first = min(start + self._run, ny), max(start - 1, 0)
            z = take_off(plane, self._rows(first, min(stop + 1, ny)), first, ny)
            here = slice(start - first, stop - first)
            height, row, column = _spike(z, here)
            spike = max(spike, (height, start + row, column), key=itemgetter(0))
            z = np.nan_to_num(z[here])
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
        """Coefficients of the least squares polynomial of a level: (k, m) -> [mm]."""
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
        # About the means, so that one row of points, of which no slope across is known, gets none.
        means, height = gram[0] / self.count, right[0] / self.count
        gram, right = gram - np.outer(gram[0], means), right - gram[0] * height
        found = np.linalg.lstsq(gram, right, rcond=1e-12)[0]
        found[0] = height - means[1:] @ found[1:]
        return found

    def _rms_about(self, level):
        terms = LEVELS[level] or LEVELS["mean"]
        right = np.array([self.products[k, m] for k, m in terms])
        return float(np.sqrt(max(self.squares - right @ self._solve(terms), 0.0) / self.count))


def _widen(extremes, z, there, axis):
    """Add heights to the lowest and the highest of each row or column, and to their number, in place."""
    low, high, known = extremes
    np.fmin(low, np.fmin.reduce(z, axis=axis), out=low)
    np.fmax(high, np.fmax.reduce(z, axis=axis), out=high)
    known[...] = np.nan_to_num(known) + np.count_nonzero(there, axis=axis)


def _spike(z, here):
    """Find the point of some rows that stands out most above its four neighbours, as far as these are there.

    Returns
    -------
    tuple
        Height above the highest of them, 0 if none does, row from the first of `here`, and column.
    """
    beyond = np.pad(z, 1, constant_values=np.nan)
    beside = np.fmax.reduce([beyond[2:, 1:-1], beyond[:-2, 1:-1], beyond[1:-1, 2:], beyond[1:-1, :-2]])
    above = np.nan_to_num((z - beside)[here])
    j, i = np.unravel_index(above.argmax(), above.shape)
    return max(float(above[j, i]), 0.0), int(j), int(i)
