"""Load paths: one problem at many loads.

Each step starts from the coarsest grid, so it depends only on its own load, and a path can be resumed after any step.
With a hardness, a step also depends on the largest load before it: a smaller load unloads the bodies elastically, from
the shape that the largest load has indented. A larger load has the same solution as without unloading.

Starting from the last solution is faster only if steps are small. This table has the operator applications for 20 loads
on a self-affine surface of 512 x 512 cells::

    loads                   patch       from scratch    from the last solution
    three decades           free        196             245
    three decades           periodic    241             351
    steps of one percent    free        204             145
    steps of one percent    periodic    247             233
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from numbers import Number
from pathlib import Path
from typing import Any

import numpy as np

from app.api.analytic_values import ANALYTIC, THEORIES
from app.api.solution import Solution
from app.base import views
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, format_exact
from app.base.petsc import synchronized
from app.base.progress_bar import progress_bar
from app.base.types import Axes, DataFrame, Figure, Length, PathLike
from app.contact.contact_moments import ContactMoments
from app.contact.grid_errors import GridErrors
from app.contact.loading_input import LOADINGS, validate_number
from app.contact.measures import PLASTIC_NUMBERS
from app.io.contact_fields import find_similar_attribute
from app.io.frames import to_dataframe
from app.problems.arrays import check_hardness
from app.problems.contact_problem import ContactProblem
from app.problems.residual_surface import ResidualSurface
from app.problems.roller import NUMBERS as ROLLER_NUMBERS

# Columns of the table that are numbers of a Solution.
COLUMNS = (
    "load", "approach", "indentation", "tilt_x", "tilt_y", "mean_pressure", "mean_gap", "contact_area",
    "contact_fraction", "contact_fraction_corrected", "perimeter", "max_pressure", "mean_contact_pressure",
    *ContactMoments._fields, *GridErrors._fields, "error_bound", "residual", "iterations", "fallbacks",
)  # fmt: skip


class LoadPath:
    """Iterator over the solutions of a load path. Collective.

    Each step is solved when the iteration comes to it. Solutions are not stored, so a path can be iterated over only
    once. After an interruption, such as Ctrl-C, the next iteration continues with the next step. A pickled path has
    only the table.

    Parameters
    ----------
    solver : ContactSolver
    kind : str
        Prescribed quantity, a name in `app.contact.loading_input.LOADINGS`.
    numbers : sequence of float
        Prescribed values, one for each step, in any order. With a hardness, smaller loads (or approaches, or larger
        mean gaps) than an earlier one unload the indented bodies.
    stiffness, flow : bool
        Solve for the exact stiffness and the conductance of every step, and for the flow through the gap, too.
    rows : sequence of dict, optional
        Rows of finished steps of the same path, from the first step on. These steps are not solved again, except the
        last one of the path.
    progress : bool
        Show a progress bar on rank 0.
    tilting : dict, optional
        Load centre, moment or tilt of all steps, see `app.contact.tilting_input.TILTING`.

    Attributes
    ----------
    rows : list of dict
        Numbers of each finished step, the same on all ranks; units are in `app.base.quantities`.
    operator_applications, solve_seconds : float
        Sums over the steps that this object has solved.

    Raises
    ------
    InputError
        If a number is not allowed, or a row belongs to another path. Raised before any step is solved.

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

    can_resume = True  # False if a step depends on more than the numbers of the steps before
    coordinates: Mapping[
        str, list[float]
    ] = {}  # name -> number of each step besides its loading, such as its time

    rows: list[dict[str, Any]]
    numbers: list[float]

    def __init__(
        self,
        solver: Any,
        kind: str,
        numbers: Iterable[Length],
        stiffness: bool = False,
        rows: Iterable[Mapping[str, Any]] = (),
        progress: bool = False,
        flow: bool = False,
        tilting: Mapping[str, Any] | None = None,
    ) -> None:
        self._solver, self._kind, self._with_stiffness, self._with_flow = solver, kind, stiffness, flow
        self._progress, self._tilting = progress, tilting or {}
        self._problem = solver.problem
        self._rank = solver.comm.rank  # the table may be saved after the solver is closed
        self.numbers = call_collectively(solver.comm, _as_numbers, kind, numbers)
        check_equal_on_ranks(solver.comm, (self.numbers, stiffness, flow), "path")
        for number in self.numbers:
            solver.check(**{kind: number}, **self._tilting)
        self.resume_after(rows)
        self.operator_applications = self.solve_seconds = 0.0
        self._steps = self._solve()

    def resume_after(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Continue the path after the finished steps in `rows`."""
        comm = self._solver.comm
        self.rows = call_collectively(comm, _as_rows, rows, self._kind, self.numbers)
        check_equal_on_ranks(comm, len(self.rows), "path")
        if self.rows and not self.can_resume:
            raise InputError("path: cannot be resumed: its steps depend on the pressures of earlier steps")
        if len(self.rows) > len(self.numbers):
            raise InputError(
                f"path: {len(self.rows)} steps are finished, but the path has only {len(self.numbers)}"
            )

    def __getstate__(self):
        return self.__dict__ | {"_solver": None, "_problem": None, "_steps": None}

    def __getattr__(self, name):
        """Raise AttributeError with a similar name, also of the table."""
        if name.startswith("_"):  # unpickling asks for names before there are attributes
            raise AttributeError(name)
        columns = dict.fromkeys(column for row in self.__dict__.get("rows", ()) for column in row)
        known = [word for word in dir(self) if word[0] != "_"]
        similar = find_similar_attribute(name, known)
        column = name if name in columns else None if similar else find_similar_attribute(name, columns)
        hint = (
            f"path.table[{column!r}] has the numbers of all steps" if column else f"did you mean {similar}?"
        )
        raise AttributeError(f"this path has no {name}" + (f"; {hint}" if column or similar else ""))

    def __repr__(self):
        return f"<{type(self).__name__}: {len(self)} steps by {self._kind}, {len(self.rows)} done>"

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Solution]:
        has_ended = self._steps is None or self._steps.gi_frame is None
        if has_ended and self._steps and len(self.rows) < len(self):  # after an interruption
            self._steps, has_ended = self._solve(), False
        if has_ended:
            raise InputError(
                "path: it has been iterated over, and its solutions are not kept; keep them by solutions = list(path); "
                "path.table has the numbers of all steps"
            )
        return self._steps

    def _solve(self):
        done = min(len(self.rows), len(self.numbers) - 1)
        steps = range(done, len(self.numbers))
        if self._progress:
            arguments = {"total": len(self), "initial": done, "desc": "path", "unit": "step"}
            steps = progress_bar(self._rank, iterable=steps, **arguments)
        history = _LoadHistory(self._problem, self._kind)
        for step in range(done):
            history.add(self.numbers[step])
        for step in steps:
            solution = self._solve_alone(history, self.numbers[step])
            if place := {name: numbers[step] for name, numbers in self.coordinates.items()}:
                solution = replace(solution, problem=solution.problem | place)
            self.rows[step:] = [self._row(step, solution)]
            yield solution

    @synchronized
    def _solve_alone(self, history, number):
        """Solve for a step while no other thread solves. Collective.

        A step may change the solver's problem.
        """
        if self._solver.problem is not self._problem:
            raise InputError("path: the solver has another problem now; make a new path")
        return self._solve_step(history, number)

    def _solve_step(self, history, number):
        """Return a step's solution for a prescribed number. Collective."""
        if not history.unloads(number):
            solution = self._solve_counted(number)
            history.add(number, solution)
            return solution
        if history.indented is None:
            # Without a solution, an earlier run has solved for the largest load.
            history.indent(history.solution or self._solve_counted(history.largest))
        with self._solver.replaced(history.indented):
            return self._solve_counted(number + history.added)

    def _solve_counted(self, number):
        """Solve for one prescribed number; count the work. Collective."""
        solution = self._solver.solve(**{self._kind: number}, **self._tilting)
        if self._with_stiffness:
            solution = self._solver.with_stiffness(solution)
        if self._with_flow:
            solution.flow()
        self.operator_applications += solution.operator_applications
        self.solve_seconds += solution.solve_seconds
        return solution

    def _row(self, step, solution):
        return {
            "step": step + 1,
            **{name: solution.problem[name] for name in self.coordinates},
            **numbers_of(solution),
            **solution.requested_numbers,
            "converged": solution.converged,
        }

    @property
    def converged(self) -> bool:
        """True if all finished steps converged."""
        return all(row["converged"] for row in self.rows)

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Table of finished steps: name -> ndarray, shape (steps,).

        Missing values are NaN. With two or more steps of the same bodies, ``stiffness_by_differences`` is the stiffness
        from differences between neighbouring steps.

        Raises
        ------
        InputError
            Before the first step is solved.
        """
        if not self.rows:
            raise InputError(
                "path: no step is solved yet: iterate over it first, for solution in path, or solutions = list(path)"
            )
        names = dict.fromkeys(name for row in self.rows for name in row)
        columns = {name: np.array([row.get(name, np.nan) for row in self.rows]) for name in names}
        if len(self.rows) > 1 and not self.coordinates:  # else the bodies of two steps differ
            columns["stiffness_by_differences"] = _slopes(columns)
        columns["converged"] = columns.pop("converged")
        return columns

    def plot(self) -> tuple[Figure, Axes]:
        """Draw the curves of the finished steps, such as load against approach.

        Return figure and axes.
        """
        return views.load().plot_path(self)

    def to_dataframe(self) -> DataFrame:
        """Return `table` as a pandas.DataFrame, indexed by steps.

        The units are in its ``attrs["units"]``.
        """
        return to_dataframe(self.table, "step")

    def _repr_html_(self):
        return views.load().path_html(self)

    def save(self, path: PathLike) -> None:
        """Write the table of the finished steps as CSV on rank 0.

        Parameters
        ----------
        path : str or Path
            Name of the file, which must end in ``.csv``.

        Raises
        ------
        InputError
            If no step is finished, or the file cannot be written.
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
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        write_table(path, rows)


class _LoadHistory:
    """Largest load of a path so far, and the indented bodies.

    Attributes
    ----------
    largest : float or None
        Prescribed number of the step with the largest load.
    solution : Solution or None
        Solution for the largest load, until the bodies unload.
    indented : ContactProblem or None
        Problem of the indented bodies, once they unload.
    added : float
        What the indentation adds to a prescribed number.
    """

    def __init__(self, problem, kind):
        self._problem, self._loading = problem, LOADINGS[kind]
        self._capped = check_hardness(problem.hardness, problem.grid) is not None
        self.largest = self.solution = self.indented = None
        self.added = 0.0

    def unloads(self, number):
        """Return whether a step unloads indented bodies."""
        if not self._capped or self.largest is None:
            return False
        return number > self.largest if self._loading.falls else number < self.largest

    def add(self, number, solution=None):
        """Record a solved step if the load is the path's largest."""
        if self._capped and not self.unloads(number):
            self.largest, self.solution, self.indented = number, solution, None

    def indent(self, solution):
        """Make the problem of the indented bodies. Collective."""
        problem, surface, self.solution = self._problem, solution.residual_surface(), None
        if not surface.depth.any():
            self.indented = problem
            return
        shape, surfaces = problem, ()
        if type(problem) is ContactProblem:
            shape = problem.shape
            surfaces = [other for other in problem.surfaces if not isinstance(other, ResidualSurface)]
        self.indented = ContactProblem(
            problem.grid,
            problem.material,
            shape,
            surfaces=(*surfaces, surface),
            hardness=problem.hardness,
            background_pressure=problem.background_pressure,
            surface_compliance=problem.surface_compliance,
        )
        self.added = self._loading.part_of_indentation(float(surface.depth.mean()))


def numbers_of(solution):
    """Return a solution's numbers for a row of a table. Collective."""
    optional = (*THEORIES, *ROLLER_NUMBERS, "worn_volume", *(f"analytic_{name}" for name in ANALYTIC))
    return {
        **{name: getattr(solution, name) for name in COLUMNS},
        **({} if solution.plastic is None else {name: getattr(solution, name) for name in PLASTIC_NUMBERS}),
        **{name: solution.problem[name] for name in optional if name in solution.problem},
        **solution.count_patches(),
    }


def _as_rows(rows, kind, numbers):
    """Return a checked copy of an earlier path's `rows`."""
    try:
        rows = [dict(row) for row in rows]
    except (TypeError, ValueError):
        rows = [{}]
    are_numbers = all(isinstance(value, Number | np.bool_) for row in rows for value in row.values())
    if not are_numbers or not all(row.keys() >= {"step", "converged", kind} for row in rows):
        raise InputError("path: rows: must be the `rows` of an earlier path")
    rounding, loading = 1e-12 * max(map(abs, numbers)), LOADINGS[kind]
    for step, (row, number) in enumerate(zip(rows, numbers, strict=False), 1):
        value = row[kind] - loading.part_of_indentation(row.get("mean_plastic_depth", 0.0))
        # A step that has not converged may have missed its load.
        if row["converged"] and not np.isclose(value, number, loading.result_rtol, rounding):
            raise InputError(
                f"path: rows: step {step} has {kind} {format_exact(value)}, this path {format_exact(number)} "
                f"{loading.unit}; they must be rows of the same path, from its first step on"
            )
    return rows


def _as_numbers(kind, numbers):
    try:
        values = [] if isinstance(numbers, str | bytes | Mapping) else list(numbers)
    except TypeError:
        values = []
    if not values:
        raise InputError(f"path: {kind}: must be a list of one number or more [{LOADINGS[kind].unit}]")
    return [validate_number(kind, number) for number in values]


def _slopes(columns):
    """Return dF/d(approach) at each step, from the steps on the same curve.

    With a hardness there is a curve of loading, and one of unloading for each load from which the bodies unload.
    """
    approach, load = columns["approach"], columns["load"]
    if "plastic_volume" not in columns:
        return _slope(approach, load)
    highest = np.maximum.accumulate(load)
    loading, slopes = ~(load < highest), np.full(len(load), np.nan)
    slopes[loading] = _slope(approach[loading], load[loading])
    for top in np.unique(highest[~loading]):
        curve, steps = highest == top, (highest == top) & ~loading
        slopes[steps] = _slope(approach[curve], load[curve])[steps[curve]]
    return slopes


def _slope(x, y):
    """Return dy/dx at each point, from the parabola through neighbouring points.

    The slope of the straight line between the neighbours is used instead if it is zero, as before first touch, or if
    the two slopes have opposite signs, as at an end after large steps. All slopes are NaN if an x has several y.
    """
    points, first, index = np.unique(x, return_index=True, return_inverse=True)
    unique_y = y[first][index]
    if len(points) < 2 or ((y < unique_y) | (y > unique_y)).any():  # NaN is neither
        return np.full(len(x), np.nan)
    with np.errstate(all="ignore"):
        chord, slope = (np.gradient(y[first], points, edge_order=k) for k in (1, min(2, len(points) - 1)))
        slope = np.where((slope * chord < 0) | (chord == 0), chord, slope)[index]
    return np.where(np.isfinite(slope), slope, np.nan)
