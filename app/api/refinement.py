"""Refinement of the grid until the discretisation error is small enough."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from app.api.notes import NoteWarnings
from app.api.solution import Solution
from app.api.solver import ContactSolver
from app.api.summary import format_grids
from app.base import views
from app.base.errors import (
    InputError,
    call_collectively,
    check_equal_on_ranks,
    check_type,
    format_exact,
    is_number,
    plain_number,
)
from app.base.petsc import check_cells, mpi_comm
from app.base.progress_bar import progress_bar
from app.base.quantities import ESTIMATED
from app.base.types import AnyComm, Axes, DataFrame, Figure, Method, Options
from app.base.usage import usage
from app.contact.grid_errors import GridErrors, GridNumbers, estimate_errors
from app.contact.history import Listener
from app.contact.loading_input import LOADINGS
from app.io.frames import to_dataframe
from app.multigrid.hierarchy import check_memory
from app.options.option_table import to_texts
from app.options.solver_options import SolverOptions
from app.parallel import mpi_abort
from app.problems.problem import Problem

MAX_CELLS = 4096**2
MIN_GRIDS = 3  # grids to solve at least; two differences show an order of convergence


class Refinement(NamedTuple):
    """Result of `refine`: last solution, its errors, all grids."""

    solution: Solution  # on the finest grid
    errors: GridErrors  # on the finest grid
    reached: bool  # True if all known errors are small enough
    stiffness: float  # dF/d(approach) [N/mm]; NaN unless requested
    rows: list[dict[str, Any]]  # one for each grid: cells, numbers, errors
    options: SolverOptions | None = None  # of the first grid

    def __repr__(self):
        state = "reached" if self.reached else "NOT reached"
        return f"Refinement, {state}; N, mm, N/mm2, mm2\n{format_grids(self.rows)}".rstrip()

    def _repr_html_(self):
        return views.load().refinement_html(self)

    def plot(self, name: str | None = None, ax: Axes | None = None) -> tuple[Figure, Any]:
        """Draw the solution on the finest grid; see `Solution.plot`."""
        return self.solution.plot(name, ax)

    def to_dataframe(self) -> DataFrame:
        """Return `rows` as a pandas.DataFrame.

        The units are in its ``attrs["units"]``.
        """
        return to_dataframe({name: [row[name] for row in self.rows] for name in self.rows[0]})


@usage("refine(problem, until=0.01, load=700)")
def refine(
    problem: Problem,
    until: float,
    most_cells: float = MAX_CELLS,
    method: Method = None,
    options: Options = None,
    comm: AnyComm = None,
    listeners: Sequence[Listener] = (),
    stiffness: bool = False,
    prefix: str | None = None,
    progress: bool = False,
    quantities: Sequence[str] = ESTIMATED,
    **loading: Any,  # numbers or texts, and a `start`
) -> Refinement:
    """Solve a problem on finer and finer grids.

    Collective over `comm`. Each grid has twice as many cells in both directions as the grid before. At least two grids
    are solved after the first one, unless there is no pressure. Errors are estimated from the changes between the last
    grids (`app.contact.grid_errors`). On the first two grids they are estimated from the coarse grids of the nested
    iteration, if there are any. -lcp_rtol is halved for each grid, because the error that the stopping test (5.1)
    leaves in the shortest waves of the pressure is inversely proportional to the wavelength.

    Parameters
    ----------
    problem : Problem
        Problem on the coarsest grid; its undeformed distance must be known on any grid.
    until : float
        Largest relative error of the `quantities`.
    most_cells : int
        Largest number of cells of the finest grid.
    method, options, comm, listeners, prefix
        Those of `ContactSolver`; -lcp_rtol applies to the first grid.
    stiffness : bool
        Solve for the stiffness and the conductance on the finest grid, too.
    progress : bool
        Show the finished grids by a progress bar (tqdm) on rank 0.
    quantities : sequence of str
        Names of the numbers whose errors count: "load", "approach", "max_pressure", "contact_area".
    **loading : float
        Prescribed quantity, see `ContactSolver.solve`.

    Returns
    -------
    Refinement
        The last grid is the first one after two others that is fine enough, or one on which the solver does not
        converge. Otherwise it is the finest grid that `most_cells` and memory allow.

    Raises
    ------
    InputError
        If the undeformed distance is known on one grid only, or if a number is not allowed.

    Examples
    --------
    >>> from app import ContactProblem, Grid, Material, refine
    >>> grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
    >>> refined = refine(sphere, until=0.03, load=700)
    >>> refined.reached, refined.errors.largest < 0.03
    (True, True)
    """
    comm = mpi_abort.abort_on_exception(mpi_comm(comm))
    call_collectively(comm, check, problem, until, most_cells, quantities, loading)
    check_equal_on_ranks(comm, (until, most_cells, stiffness, quantities), "refine")
    rows, numbers, first_options = [], [], None
    options = call_collectively(comm, to_texts, options or {})
    bar = progress_bar(comm.rank, desc="refine", unit="grid") if progress else None
    while True:
        grid = problem.grid
        with ContactSolver(problem, method, options, comm, prefix, listeners) as solver:
            solver.quiet = True  # only notes on the finest grid matter
            solution = solver.solve(**loading)
            if bar is not None:
                bar.update()
            first_options = first_options or solver.options
            loading.pop("start", None)  # of the first grid
            errors = GridErrors(*(getattr(solution, name) for name in GridErrors._fields))
            values = solution.load, solution.approach, solution.max_pressure, solution.contact_area
            numbers.append(GridNumbers(*values))
            if len(numbers) >= MIN_GRIDS or np.isnan(errors.largest):
                change = solution.discretisation_error
                errors = estimate_errors(numbers, solver.touching, _exact(loading), change)
                errors = errors.add_contact_edge(solution, change, problem)
            solution = replace(solution, **errors._asdict())
            rows.append(_row(solution, errors))
            small = errors.largest_of(quantities) <= until
            # Without a pressure there is nothing to refine.
            reached = solution.converged and ((small and len(rows) >= MIN_GRIDS) or not solution.load)
            last = 4 * grid.n > most_cells or not _has_room(solver, grid.refine())
            if reached or not solution.converged or last:
                if solution.converged and not reached:
                    cells = f"{grid.nx} x {grid.ny} cells"
                    reason = "most_cells= (-refine_max)" if 4 * grid.n > most_cells else "memory"
                    doubt = f"estimated errors are still above {format_exact(until)}"
                    if small:
                        doubt = f"{len(rows)} of at least {MIN_GRIDS} grids are solved, so the errors are not confirmed"
                    short = f"stopped at {cells} by {reason}: {doubt}"
                    solution = replace(solution, notes=(*solution.notes, short))
                if stiffness or problem.material.is_conducting:
                    solution = solver.with_stiffness(solution)
                exact = solution.stiffness if stiffness else float("nan")
                NoteWarnings().issue(problem, solution.notes)
                if bar is not None:
                    bar.close()
                return Refinement(solution, errors, reached, exact, rows, first_options)
            options["lcp_rtol"] = solver.settings.rtol / 2
        problem = problem.on(grid.refine())


def _has_room(solver, grid):
    """Return whether a solver on the grid fits into memory. Collective."""
    try:
        check_cells(grid)
        check_memory(solver.comm, solver.problem, grid, solver.settings)
    except InputError:
        return False
    return True


def check(problem, until, most_cells, quantities, loading):
    """Raise InputError if a problem cannot be refined, or limits are wrong."""
    check_type("problem", problem, Problem, "a ContactProblem")
    until = plain_number(until)
    if not (is_number(until) and 0 < until < 1):
        raise InputError(f"refine until {until}: must be a relative error above 0 and below 1")
    if not (is_number(most_cells) and most_cells > 0):
        raise InputError(f"refine most_cells {most_cells!r}: must be a positive number")
    if isinstance(quantities, str) or not quantities or not set(quantities) <= set(ESTIMATED):
        raise InputError(f"quantities= (-refine_for) {quantities!r}: must be among {', '.join(ESTIMATED)}")
    if set(quantities) <= _exact(loading):
        raise InputError(f"quantities= (-refine_for) {', '.join(quantities)}: prescribed, so it has no error")
    for part in ("hardness", "background pressure", "surface compliance"):
        if np.ndim(getattr(problem, part.replace(" ", "_"))):
            raise InputError(f"problem {problem.name}: a {part} known on its grid only; must be a number")
    if not problem.refinable:
        raise InputError(
            f"problem {problem.name}: its undeformed distance is known on one grid only; "
            "refining needs a function, a generated surface or a measured one that is resampled() (-surface_resample)"
        )


def _exact(loading):
    """Return the quantities that a loading fixes."""
    return {name for kind in LOADINGS if loading.get(kind) is not None for name in LOADINGS[kind].exact}


def _row(solution, errors):
    grid = solution.grid
    return {
        "nx": grid.nx,
        "ny": grid.ny,
        **{name: getattr(solution, name) for name in ESTIMATED},
        **errors._asdict(),
        "solve_seconds": solution.solve_seconds,
        "converged": solution.converged,
    }
