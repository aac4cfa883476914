"""Law of a contact: a table over a range of loads, for finite element and multibody programs.

Such a program needs the load as an increasing, smooth function of the approach, and its derivative. Here the logarithm
of the indentation is interpolated over the logarithm of the load, by a monotone cubic through exact slopes: d log
indentation / d log load is load / (stiffness indentation). A power law, such as Hertz's, is exact. Largest errors of
the load for other variables, in intervals of a factor 2.4 (a ball, and a rough ball) and 3.2 (a rough periodic patch)::

    cubic                               ball      rough ball    rough patch
    log indentation over log load       1e-3      2e-2          2e-2
    log load over log indentation       1e-3      2e-2          1e-1
    log load over approach              4e-3      2e-2          1e-1

F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238-246: a cubic is monotone if its slopes at the ends
are at most 3 times that of the chord.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cached_property, partial
from itertools import pairwise
from math import ceil, log10, sqrt
from numbers import Integral
from typing import Any

import numpy as np

from app.base.errors import (
    InputError,
    check_equal_on_ranks,
    format_exact,
    is_number,
    plain_number,
    warn_caller,
)
from app.base.progress_bar import progress_bar
from app.base.types import ArrayLike, DataFrame, PathLike
from app.base.usage import usage
from app.contact.loading_input import LOADINGS, single_loading, validate_number
from app.io.frames import to_dataframe
from app.problems.arrays import real_numbers

_COLUMNS = (  # numbers of a Solution
    "load", "mean_pressure", "approach", "indentation", "mean_gap", "contact_area", "contact_fraction_corrected",
    "max_pressure",
)  # fmt: skip
_SLIP = "tangential_displacement", "stick_area", "dissipated_energy"  # columns from a `PartialSlip`
_HALVINGS = 60  # of the bisection that inverts the cubic
_SAMPLES = 4  # in half an interval, at which the error is estimated
_ROUNDING = 1e-9  # of log load
_BEYOND = 40.0  # distance in log load to which the power laws at both ends continue


class ContactLaw:
    """Numbers of a contact over a range of loads, and interpolation between them.

    Attributes
    ----------
    table : dict of str to ndarray, shape (loads,)
        Numbers of the solved loads, sorted by load, with the names of a Solution's numbers, stiffness, conductance and
        flow. Similar half-spaces have a ``tangential_stiffness`` without slip [N/mm]; with friction they also have
        ``tangential_displacement`` [mm], ``stick_area`` [mm2] and ``dissipated_energy`` of a full cycle [N mm].
    error : float
        Largest relative change of the interpolated load at a given approach, when the middle of an interval was added.
        A smooth law is 16 times as accurate; one with few cells in contact, whose stiffness has steps, is not.
    notes : list of list of str
        Notes (warnings) of each load's solution.
    """

    def __init__(self, rows: Iterable[dict[str, Any]], error: float = np.nan, rank: int = 0) -> None:
        rows = sorted(rows, key=lambda row: row["load"])
        self.notes = [row.get("notes", []) for row in rows]
        names = dict.fromkeys(name for row in rows for name in row if name != "notes")
        self.table = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
        self.error, self._rank = error, rank

    def __repr__(self):
        load = self.table["load"]
        return f"<ContactLaw: {len(load)} loads from {load[0]:g} to {load[-1]:g} N, error {self.error:.1e}>"

    @cached_property
    def _cubic(self):
        """Log indentation over log load, with straight lines past the ends."""
        from scipy.interpolate import CubicHermiteSpline  # loads slowly

        load, indentation, stiffness = (self.table[name] for name in ("load", "indentation", "stiffness"))
        x, y, slope = np.log(load), np.log(indentation), load / (stiffness * indentation)
        chord = np.diff(y) / np.diff(x)
        slope[1:] = np.minimum(slope[1:], 3 * chord)
        slope[:-1] = np.minimum(slope[:-1], 3 * chord)
        x, y, slope = (np.pad(values, 1, "edge") for values in (x, y, slope))
        for end, step in ((0, -_BEYOND), (-1, _BEYOND)):
            x[end] += step
            y[end] += step * slope[end]
        return CubicHermiteSpline(x, y, slope)

    def _invert(self, indentation):
        """Return log load at an indentation, by bisection."""
        y, cubic = np.log(indentation), self._cubic
        low, high = np.full(y.shape, cubic.x[0]), np.full(y.shape, cubic.x[-1])
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            is_below = cubic(middle) < y
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return high

    @usage("law.at(approach=0.001), or load=, indentation=")
    def at(self, **given: ArrayLike) -> dict[str, np.ndarray]:
        """Return the numbers at loads, approaches or indentations.

        Parameters
        ----------
        **given : float or array_like
            Exactly one of load [N], approach [mm], and approach beyond first touch [mm].

        Returns
        -------
        dict of str to ndarray
            Load, approach, indentation and stiffness from the monotone cubic: the stiffness is its derivative. Beyond
            the table they continue as power laws, and both load and stiffness are 0 before first touch. Other numbers
            are interpolated by PCHIP, and are NaN beyond the table. All numbers are NaN at NaN and at negative loads.

        Raises
        ------
        InputError
            If not exactly one of the three is given, or its values are no numbers.
        """
        from scipy.interpolate import PchipInterpolator

        if len(given) != 1 or not given.keys() <= {"load", "approach", "indentation"}:
            raise InputError("law: give exactly one of load [N], approach [mm] and indentation [mm]")
        ((kind, value),) = given.items()
        value, table = real_numbers(f"law: {kind}", value, "a number, or an array of them"), self.table
        if kind == "load":
            value = np.where(value < 0, np.nan, value)
        touching = table["approach"][0] - table["indentation"][0]
        value = value - touching if kind == "approach" else value
        touches = value > 0
        positive = np.where(touches, value, 1.0)
        x = np.log(positive) if kind == "load" else self._invert(positive)
        load = np.where(touches, positive if kind == "load" else np.exp(x), 0.0)
        indentation = np.where(touches, np.exp(self._cubic(x)), 0.0) if kind == "load" else value
        stiffness = np.where(touches, np.exp(x - self._cubic(x)) / self._cubic(x, 1), 0.0)
        found = {"load": load, "approach": touching + indentation, "indentation": indentation}
        found["stiffness"] = stiffness
        inside = np.clip(x, *np.log(table["load"][[0, -1]]))
        is_known = touches & (np.abs(x - inside) < _ROUNDING)
        for name, column in table.items():
            if name not in found and column.dtype != bool and np.isfinite(column).all():
                is_positive = (column > 0).all()
                curve = PchipInterpolator(np.log(table["load"]), np.log(column) if is_positive else column)
                values = curve(inside)
                found[name] = np.where(is_known, np.exp(values) if is_positive else values, np.nan)
        return {name: np.where(np.isnan(value), np.nan, numbers) for name, numbers in found.items()}

    def to_dataframe(self) -> DataFrame:
        """Return `table` as a pandas.DataFrame with units in ``attrs["units"]``."""
        return to_dataframe(self.table)

    def save(self, path: PathLike) -> None:
        """Write the table on rank 0, as ``.csv``, ``.h5``, ``.mat``, ``.md`` or ``.txt``.

        Raises InputError if the file cannot be written.
        """
        from app.io.table import write_table

        columns = {name: column.tolist() for name, column in self.table.items()}
        if not self._rank:
            write_table(
                path, [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            )


class Laws:
    """Method of `ContactSolver` that computes a `ContactLaw`."""

    @usage("solver.law(load=(1, 1000)), or mean_pressure=")
    def law(
        self,
        *,
        tolerance: float = 1e-3,
        flow: bool = False,
        friction: float | None = None,
        tangential_share: float | None = None,
        max_points: int = 200,
        progress: bool = False,
        **loadings: Sequence[float] | None,
    ) -> ContactLaw:
        """Solve for a range of loads, so close that interpolation is accurate.

        The middle of each interval is solved and added. The halves are halved again if this changed the interpolated
        load by more than the tolerance.

        Parameters
        ----------
        tolerance : float
            Largest relative change of the interpolated load by another point.
        flow : bool
            Solve for the flow through the gap at each load, too; the table then has the columns of `Solution.flow`.
        friction, tangential_share : float, optional
            Coefficient of friction mu, and tangential load over mu times normal load, above 0 and at most 1. With them
            the table has three columns of `slip`.
        max_points : int
            Largest number of solved loads, at least 3. A RuntimeWarning is issued if it does not suffice.
        progress : bool
            Show the number of solved loads (tqdm) on rank 0.
        **loadings : sequence of float
            Smallest and largest load [N], or mean_pressure [N/mm2], positive; exactly one of the two. Numbers between
            them are solved first, by default one for each decade, and at least one.

        Returns
        -------
        ContactLaw

        Raises
        ------
        InputError
            If a number is not allowed, or the problem has a background pressure, or a periodic patch is in full
            contact, where the approach no longer changes. With friction, see `slip`.
        """
        self._check_open()
        kind, ends = single_loading(loadings, "law: ")
        check_equal_on_ranks(
            self.comm, (kind, ends, tolerance, flow, friction, tangential_share, max_points), "law"
        )
        starts = _check_range(kind, ends)
        first, last = starts[0], starts[-1]
        _check_positive(tolerance=tolerance)
        if not isinstance(max_points, Integral) or max_points < 3:
            raise InputError(f"law: max_points {max_points}: must be a whole number from 3")
        if self.problem.background_pressure is not None:
            raise InputError("law: not with a background pressure")
        for number in (first, last):
            self.check(**{kind: number})
        ratio = None
        with suppress(InputError):
            ratio = self._check_similar()
        if friction is not None or tangential_share is not None:
            _check_positive(friction=friction, tangential_share=tangential_share)
            if tangential_share > 1:
                raise InputError(
                    f"law: tangential_share {tangential_share}: must be at most 1, else the bodies slide"
                )
            load = first if kind == "load" else first * self.problem.grid.area
            ratio = self._check_slip(load, friction, [friction * tangential_share * load])
        if len(starts) == 2:
            starts = np.geomspace(
                first, last, min(max_points, max(3, ceil(log10(last / first)) + 1))
            ).tolist()
        if len(starts) > max_points:
            raise InputError(f"law: max_points {max_points}: must be at least {len(starts)}, the first loads")
        with progress_bar(self.comm.rank if progress else 1, desc="law", unit="load") as bar:
            solve = partial(self._law_row, bar, kind, flow, ratio, friction, tangential_share)
            rows = {number: solve(number) for number in reversed(starts)}
            pending, error = [(*ends, np.inf) for ends in pairwise(starts)], 0.0
            while pending and len(rows) + len(pending) <= max_points:
                halves = []
                for low, high, _ in pending:
                    middle = sqrt(low * high)
                    rows[middle] = row = solve(middle)
                    wrong = _load_error([rows[low], rows[high]], row)
                    if not wrong <= tolerance:
                        halves += [(low, middle, wrong), (middle, high, wrong)]
                    else:
                        error = max(error, wrong)
                pending = halves
        if pending:
            error = max(wrong for _, _, wrong in pending)
            warn_caller(f"law: {len(rows)} loads do not suffice, the error is {error:.1e}; raise max_points")
        return ContactLaw(list(rows.values()), error, self.comm.rank)

    def _law_row(self, bar, kind, flow, ratio, friction, share, number):
        """Solve for one load; return its row. Collective."""
        solution = self.with_stiffness(self.solve(**{kind: number}))
        if np.isnan(solution.stiffness):
            raise InputError(
                f"law: {kind} {format_exact(number)}: the stiffness was not found: CG did not converge"
            )
        if not 0 < solution.stiffness < np.inf:
            raise InputError(
                f"law: {kind} {format_exact(number)}: the stiffness is {format_exact(solution.stiffness)}, as in full "
                "contact of a periodic patch; choose a smaller range"
            )
        if flow:
            solution.flow()
        row = {name: getattr(solution, name) for name in _COLUMNS} | solution.requested_numbers
        if ratio is not None:  # before any slip, the whole contact sticks
            row["tangential_stiffness"] = solution.unloading_stiffness / ratio
        if friction is not None:
            slip = self._slip(solution, ratio, friction, friction * share * solution.load)
            row |= {name: getattr(slip, name) for name in _SLIP}
        bar.update()
        return row | {
            "error_bound": solution.error_bound, "converged": solution.converged, "notes": solution.notes,
        }  # fmt: skip


def _load_error(ends, middle):
    """Return the largest relative change of the interpolated load in an interval, by its middle."""
    before, after = (ContactLaw(rows)._cubic for rows in (ends, [*ends, middle]))
    x = np.linspace(*before.x[1:-1], 2 * _SAMPLES + 1)
    return float(np.max(np.abs(after(x) - before(x)) / after(x, 1)))


def _check_range(kind, ends):
    """Return the loads of a law that are solved first, checked."""
    if kind not in ("load", "mean_pressure"):
        raise InputError(f"law: {kind}: give a range of load or mean_pressure")
    if np.ndim(ends) != 1 or len(ends) < 2:
        raise InputError(
            f"law: {kind}: must be two numbers or more, the smallest first, the largest last [{LOADINGS[kind].unit}]"
        )
    starts = [validate_number(kind, number) for number in ends]
    for low, high in pairwise(starts):
        if not 0 < low < high:
            raise InputError(
                f"law: {kind} {format_exact(low)} to {format_exact(high)}: must be positive and increase"
            )
    return starts


def _check_positive(**numbers):
    for name, number in numbers.items():
        value = plain_number(number)
        if not (is_number(value) and 0 < value < np.inf):
            raise InputError(f"law: {name} {number}: must be a positive number")
