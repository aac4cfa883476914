"""Sums over a height map, which is looked at once, a run of rows after the other: level, tilt, rms height and slope."""

from __future__ import annotations

import numpy as np

from app.errors import InputError
from app.options import LARGEST

LEVELS = {"none": (), "mean": ((0, 0),)}
LEVELS["plane"] = (*LEVELS["mean"], (1, 0), (0, 1))
LEVELS["quadratic"] = (*LEVELS["plane"], (2, 0), (1, 1), (0, 2))  # powers of x and y that are taken off
_RUN = 1 << 18  # cells that are looked at together


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
        ``rows(start, stop)`` gives rows of heights, NaN where missing [mm].
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
        self._spike = (0.0, 0, 0)  # height above the highest of its four neighbours [mm], row, column
        x, y, run, beyond = centred(nx), centred(ny), self._run, np.full((1, nx), np.nan)
        held = beyond  # the last rows of the run before, one beside whose neighbours are not all known yet
        for start in range(0, ny, run):
            z = rows(start, min(start + run, ny))
            self._add(z, x, y[start : start + run], start)
            self._add_steps(0, np.diff(z, axis=1))
            self._add_steps(1, np.diff(np.vstack([held[-1:], z]), axis=0))
            block = np.vstack([held, z, *([beyond] if start + run >= ny else [])])
            self._find_spike(block, start - len(held) + 1)
            held = block[-2:]
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
                f"surface file {self._name}: {z[j, i]:g} mm in row {first + j}, column {i}; allowed: numbers, and NaN "
                "for missing points"
            )
        if self.reference is None:
            self.reference = z[there][0]  # so that large offsets cost no digits
        z = np.where(there, z - self.reference, 0.0)
        in_x, in_y = (np.stack([values**k for k in range(5)]) for values in (x, y))
        self.powers += in_x @ there.T.astype(float) @ in_y.T
        self.products += in_x[:3] @ z.T @ in_y[:3].T
        self.squares += float(np.einsum("ji,ji", z, z))

    def _add_steps(self, along, steps):
        known = steps[np.isfinite(steps)]
        self._steps[along] += known.size, known.sum(), known @ known

    def _find_spike(self, z, first):
        """Look through all rows but the first and the last, neighbours only; `first`: number of the second."""
        inner = z[1:-1]
        if not inner.size:
            return
        above = np.fmin(inner - z[:-2], inner - z[2:])  # fmin: missing neighbours do not count
        across = np.diff(inner, axis=1)
        above[:, 1:] = np.fmin(above[:, 1:], across)
        above[:, :-1] = np.fmin(above[:, :-1], -across)
        j, i = np.unravel_index(np.nan_to_num(above).argmax(), above.shape)
        if above[j, i] > self._spike[0]:
            self._spike = float(above[j, i]), first + int(j), int(i)

    @property
    def count(self):
        """Points that are there."""
        return self.powers[0, 0]

    @property
    def steps(self):
        """Root mean square of the steps from cell to cell in x and in y, about the best plane's [mm]; NaN: none."""
        _, *tilt = self._solve(LEVELS["plane"])
        count, total, squares = self._steps.T
        plane = 2 * np.array(tilt) / self.shape[::-1]
        with np.errstate(invalid="ignore"):
            mean = (squares - 2 * plane * total) / count + plane**2
        return tuple(float(step) for step in np.sqrt(np.maximum(mean, 0.0)))

    def spike(self):
        """How high the point that stands out most does above all beside it [mm], in rms steps; its row and column."""
        height, row, column = self._spike
        step = max((step for step in self.steps if step > 0), default=np.inf)
        return height, height / step, row, column

    def tilt(self):
        """Rise of the best plane from side to side, and the standard deviation about it [mm]."""
        plane = self._solve(LEVELS["plane"])
        return float(2 * (abs(plane[1]) + abs(plane[2]))), self._rms_about("plane")

    def roughness(self, level):
        """What a `Surface` says of its heights, by name; skewness and kurtosis by a second look at all of them."""
        if level == "quadratic":  # what it leaves is pressed, not what is about the plane

            def left(start, stop):
                return take_off(bowl, self._rows(start, stop), start, self.shape[0])

            bowl = self.fit(level)
            return Moments(self._name, left, self.shape).roughness("none")
        (mean, *slopes), sums, (ny, nx) = self._solve(LEVELS["plane"]), np.zeros(3), self.shape
        rms = self._rms_about("plane")
        for start in range(0, ny, self._run):
            z = self._rows(start, min(start + self._run, ny)) - (self.reference + mean)
            z -= slopes[0] * centred(nx) + slopes[1] * centred(ny)[start : start + len(z), None]
            z[np.isnan(z)] = 0.0
            z /= rms or 1.0
            square = z * z
            sums += [np.sum(square), np.vdot(square, z), np.vdot(square, square)]
        square, cube, fourth = sums / self.count
        return {
            "rms_height": self._rms_about(level),
            "rms_level": rms,
            "skewness": float(cube / square**1.5) if square else np.nan,
            "kurtosis": float(fourth / square**2) if square else np.nan,
            "steps": self.steps,
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
        return np.linalg.lstsq(gram, right, rcond=1e-12)[0]  # of one row of points no slope across is known

    def _rms_about(self, level):
        terms = LEVELS[level] or LEVELS["mean"]
        right = np.array([self.products[k, m] for k, m in terms])
        return float(np.sqrt(max(self.squares - right @ self._solve(terms), 0.0) / self.count))
