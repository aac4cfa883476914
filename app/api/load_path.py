"""Load paths: one problem, many loads, in one process.

Every step is solved for itself: the nested iteration begins anew on the coarsest grid. So a row depends on nothing but
its own load, and a path goes on from any row. To start from the step before pays only where steps are small: 20 loads
on a self-affine surface of 512 x 512 cells, free and periodic, take 196 and 241 operator applications anew and 245 and
351 from the last solution over three decades, 204 and 247 against 145 and 233 in steps of a percent.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from numbers import Number
from pathlib import Path

import numpy as np

from app.api.analytic_values import ANALYTIC, THEORIES
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, format_exact
from app.contact.contact_moments import ContactMoments
from app.contact.grid_errors import GridErrors
from app.contact.loading_input import LOADINGS, validate_number

# Columns of the table that a solution has by these names, after `load` and the like what beside it is known.
COLUMNS = (
    "load", "approach", "indentation", "mean_pressure", "mean_gap", "contact_area", "contact_fraction",
    "contact_fraction_corrected", "perimeter", "max_pressure", "mean_contact_pressure", *ContactMoments._fields,
    *GridErrors._fields, "error_bound", "residual", "iterations", "fallbacks",
)  # fmt: skip


class LoadPath:
    """The solutions along a path, one after the other: iterate over it, then look at its table.

    Collective, as is every step. Nothing is solved before it is iterated over, which can be done once: it keeps no
    solutions. Where that was cut short, by Ctrl-C say, the next time goes on after the steps that are done. A pickled
    one keeps its table, and has no steps to come.

    Parameters
    ----------
    solver : ContactSolver
    kind : str
        What is prescribed: load, mean_pressure, approach or mean_gap.
    numbers : sequence of float
        One for each step, in any order.
    stiffness : bool
        Solve for the exact stiffness of every step, too.
    rows : sequence of dict, optional
        Of steps done already, from the first on, at the same loads: they are taken as they are and their solutions left
        out. The last step is solved in any case.

    Attributes
    ----------
    rows : list of dict
        A row for each step done so far: names and units in `app.base.quantities`; the same on all ranks.
    operator_applications, solve_seconds : float
        Of the steps done here.

    Raises
    ------
    InputError
        If a number is not allowed, or a row is of another one; before any step is solved.

    Examples
    --------
    >>> from app import ContactProblem, ContactSolver, Grid, Material
    >>> grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
    >>> with ContactSolver(sphere) as solver:
    ...     path = solver.path(load=[200, 400, 800])
    ...     fractions = [round(solution.contact_fraction, 1) for solution in path]
    >>> fractions, path.table["load"]
    ([0.1, 0.1, 0.2], array([200., 400., 800.]))
    """

    def __init__(self, solver, kind, numbers, stiffness=False, rows=()):
        self._solver, self._kind, self._with_stiffness = solver, kind, stiffness
        self._problem = solver.problem
        self._rank = solver.comm.rank  # the solver may be closed when the table is saved
        self.numbers = call_collectively(solver.comm, _as_numbers, kind, numbers)
        check_equal_on_ranks(solver.comm, (self.numbers, stiffness), "path")
        solver.check_all([{kind: number} for number in self.numbers])
        self.go_on_after(rows)
        self.operator_applications = self.solve_seconds = 0.0
        self._steps = self._solve()

    def go_on_after(self, rows):
        """Take the `rows` of steps done already, before one is solved here. Collective."""
        comm = self._solver.comm
        self.rows = call_collectively(comm, _as_rows, rows, self._kind, self.numbers)
        check_equal_on_ranks(comm, len(self.rows), "path")
        if len(self.rows) > len(self.numbers):
            raise InputError(f"path: {len(self.rows)} steps are done already, of {len(self.numbers)}")

    def __getstate__(self):
        return self.__dict__ | {"_solver": None, "_problem": None, "_steps": None}

    def __repr__(self):
        return f"<LoadPath: {len(self)} steps by {self._kind}, {len(self.rows)} done>"

    def __len__(self):
        return len(self.numbers)

    def __iter__(self):
        ended = self._steps is None or self._steps.gi_frame is None
        if ended and self._steps and len(self.rows) < len(self):  # it was cut short, and goes on
            self._steps, ended = self._solve(), False
        if ended:
            raise InputError(
                "path: it has been iterated over, and its solutions are not kept; keep them by solutions = list(path); "
                "path.table has the numbers of all steps"
            )
        return self._steps

    def _solve(self):
        done = min(len(self.rows), len(self.numbers) - 1)
        for step in range(done, len(self.numbers)):
            if self._solver.problem is not self._problem:
                raise InputError("path: its solver has been given another problem; make a path of that")
            solution = self._solver.solve(**{self._kind: self.numbers[step]})
            if self._with_stiffness:
                solution = replace(solution, stiffness=self._solver.stiffness(solution))
            self.operator_applications += solution.operator_applications
            self.solve_seconds += solution.solve_seconds
            self.rows[step:] = [self._row(step, solution)]
            yield solution

    def _row(self, step, solution):
        known = (*THEORIES, *(f"analytic_{name}" for name in ANALYTIC))
        row = {
            "step": step + 1,
            **{name: getattr(solution, name) for name in COLUMNS},
            **{name: solution.problem[name] for name in known if name in solution.problem},
            **solution.count_patches(),
        }
        if self._with_stiffness:
            row["stiffness"] = solution.stiffness
        return row | {"converged": solution.converged}

    @property
    def converged(self):
        """Whether all steps done so far are solved. Not collective."""
        return all(row["converged"] for row in self.rows)

    @property
    def table(self):
        """The rows as columns: name -> ndarray, shape (steps,); NaN where a step has none. Not collective.

        With two steps and more a column more: the stiffness by differences of neighbouring steps.

        Raises
        ------
        InputError
            If no step is solved yet.
        """
        if not self.rows:
            raise InputError(
                "path: no step is solved yet: iterate over it first, for solution in path, or solutions = list(path)"
            )
        names = dict.fromkeys(name for row in self.rows for name in row)
        columns = {name: np.array([row.get(name, np.nan) for row in self.rows]) for name in names}
        if len(self.rows) > 1:
            columns["stiffness_by_differences"] = _slope(columns["approach"], columns["load"])
        columns["converged"] = columns.pop("converged")
        return columns

    def save(self, path):
        """Write the table of the steps solved so far as CSV, whole or not at all. Rank 0 only writes; not collective.

        Parameters
        ----------
        path : str or Path
            Ends in ``.csv``.

        Raises
        ------
        InputError
            If no step is solved yet, or it cannot be written.
        """
        from app.io.table import write_table

        if not isinstance(path, str | os.PathLike) or Path(path).suffix.lower() != ".csv":
            raise InputError(
                f"path table {path}: the name must end in .csv; a result file with the table and the fields of a step: "
                "solution.save(file, steps=path.table)"
            )
        columns = {name: column.tolist() for name, column in self.table.items()}
        if self._rank:
            return
        try:
            write_table(
                path, [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            )
        except (OSError, ValueError) as error:
            raise InputError(
                f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}"
            ) from None


def _as_rows(rows, kind, numbers):
    """Rows of an earlier path by the same numbers, copied."""
    try:
        found = [dict(row) for row in rows]
    except (TypeError, ValueError):
        found = [{}]
    whole = all(isinstance(value, Number | np.bool_) for row in found for value in row.values())
    if not whole or not all(row.keys() >= {"step", "converged", kind} for row in found):
        raise InputError("path: rows: needed: those of an earlier path, as its `rows` are")
    rounding = 1e-12 * max(map(abs, numbers))
    for step, (row, number) in enumerate(zip(found, numbers, strict=False), 1):
        # What is not solved may have missed its load.
        if row["converged"] and not np.isclose(row[kind], number, 1e-9, rounding):
            raise InputError(
                f"path: rows: step {step} has {kind} {format_exact(row[kind])}, this path {format_exact(number)} "
                f"{LOADINGS[kind]}; needed: rows of the same path, from its first step on"
            )
    return found


def check_one_kind(loadings):
    """Return the loadings of a path if they are one. Not collective."""
    if len(loadings) != 1 or not loadings.keys() <= LOADINGS.keys():
        raise InputError(f"path: needed: exactly one of {', '.join(LOADINGS)}, a number for each step")
    return loadings


def _as_numbers(kind, numbers):
    try:
        found = [] if isinstance(numbers, str | bytes | Mapping) else list(numbers)
    except TypeError:
        found = []
    if not found:
        raise InputError(f"path: {kind}: needed: a list of one number or more [{LOADINGS[kind]}]")
    return [validate_number(kind, number) for number in found]


def _slope(x, y):
    """Slope of the parabola through each point and its neighbours; NaN where there is more than one y at an x.

    At an end where that has the other sign, as after large steps of a load, or where the chord has none, as before
    first touch, the slope of the chord.
    """
    at, first, which = np.unique(x, return_index=True, return_inverse=True)
    one = y[first][which]
    if len(at) < 2 or ((y < one) | (y > one)).any():  # NaN is neither
        return np.full(len(x), np.nan)
    with np.errstate(all="ignore"):
        chord, slope = (np.gradient(y[first], at, edge_order=k) for k in (1, min(2, len(at) - 1)))
        slope = np.where((slope * chord < 0) | (chord == 0), chord, slope)[which]
    return np.where(np.isfinite(slope), slope, np.nan)
