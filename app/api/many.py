"""Solution of many problems, on one process or several."""

import signal
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from multiprocessing import get_context
from multiprocessing.connection import wait
from numbers import Integral
from os import environ
from pickle import HIGHEST_PROTOCOL, PicklingError, dumps
from traceback import format_exc
from typing import Any, NamedTuple

import numpy as np

from app.api.load_path import COLUMNS, numbers_of
from app.api.notes import NoteWarnings
from app.api.solution_table import SolutionTable
from app.api.solver import ContactSolver
from app.base.errors import (
    InputError,
    call_collectively,
    check_equal_on_ranks,
    check_type,
    format_error,
    format_message,
    plain_number,
    warn_caller,
)
from app.base.mpi import MPI, single_rank_variables, temporary_environment
from app.base.petsc import mpi_comm
from app.base.progress_bar import progress_bar
from app.base.types import AnyComm, ArrayLike, Method, Options, PathLike
from app.base.usage import usage
from app.base.user_folder import existing_folder
from app.contact.loading_input import LOADINGS, USAGE, single_loading, validate_number
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.io.field_stack import check_fields, open_field_stack
from app.parallel import mpi_abort
from app.problems.contact_problem import ContactProblem
from app.problems.problem import Problem
from app.problems.shapes import Plane

CHUNKS_PER_PROCESS = 8  # at least, so that all processes end at about the same time
MAX_CHUNK = 16  # problems that a process gets at once
_REMEDY = "define its functions in a module, or use processes=1"
_MAX_NAMED = 5  # failed problems in a warning


class _Job(NamedTuple):
    """One job of `solve_many`: a problem and its loads."""

    number: int  # of the problem
    first_row: int
    problem: Problem
    loads: list


@usage(f"solve_many(problems, {USAGE}")
def solve_many(
    problems: Iterable[Any],
    loads: ArrayLike | None = None,
    processes: int = 1,
    *,
    grid: Grid | None = None,
    material: Material | None = None,
    method: Method = None,
    options: Options = None,
    comm: AnyComm = None,
    output: PathLike | None = None,
    fields: Sequence[str] = ("pressure", "gap"),
    progress: bool = False,
    **loading: ArrayLike | None,
) -> SolutionTable:
    """Solve many problems, each for one load or several.

    Problems on the same grid and material share one solver. Every solve starts from scratch, so its numbers do not
    depend on other solves or on the number of processes. Collective over `comm`.

    Parameters
    ----------
    problems : iterable of Problem, or of surfaces
        An iterator is read to its end first. Surfaces are pressed on a plane; they are heights [mm], peaks up, as
        arrays (ny, nx), functions or surfaces, like ``surfaces`` of `ContactProblem`. Surfaces need `grid` and
        `material`.
    loads : float, or sequence
        Total forces [N]: a number for all problems; a sequence with a number for each problem; or a sequence with a
        sequence of numbers for each problem. ``[[10, 20]]`` are two loads for all problems.
    processes : int
        If above 1, a program must call this function below ``if __name__ == "__main__":``, and functions in problems
        must be defined in a module.
    **loading : optional
        Another prescribed quantity of `app.solve`, instead of `loads` and in the same forms.
    grid : Grid, optional
    material : Material, optional
    method, options, comm
        As of `ContactSolver`.
    output : str or Path, optional
        HDF5 file for `fields` of all rows, written completely or not at all, see `app.io.field_stack`. It needs
        problems on one grid.
    fields : sequence of str
        Among pressure, gap, displacement, undeformed_distance, contact, plastic and plastic_depth.
    progress : bool
        Show a progress bar (tqdm) on rank 0.

    Returns
    -------
    SolutionTable
        A row for each problem and load, in order; the column `problem` counts from 0. A RuntimeWarning gives the
        numbers of problems that did not converge or were refused; their rows have a `message`. Each kind of notes is
        issued once.

    Raises
    ------
    InputError
        If problems, loads or options are not allowed; before any work.

    Examples
    --------
    >>> import numpy as np
    >>> from app import Grid, Material, solve_many
    >>> grid, steel = Grid.from_domain(32, 32, (0, 1, 0, 1)), Material.combined(80000, 0.3)
    >>> surfaces = 1e-3 * np.random.default_rng(1).random((3, 32, 32))
    >>> table = solve_many(surfaces, [[10, 100]], grid=grid, material=steel)
    >>> table["problem"], table["load"], table.converged
    (array([0, 0, 1, 1, 2, 2]), array([ 10., 100.,  10., 100.,  10., 100.]), True)
    """
    comm = mpi_abort.abort_on_exception(mpi_comm(comm))
    if loads is not None:
        loading["loads" if "load" in loading else "load"] = loads  # both are refused
    kind, jobs = call_collectively(comm, _make_jobs, problems, loading, grid, material)
    call_collectively(comm, _check_processes, processes, jobs)
    requests = kind, [job.loads for job in jobs], processes, output is None
    check_equal_on_ranks(comm, requests, "solve_many: loads, processes or output")
    if output is None:
        fields = ()
    else:
        grids = [job.problem.grid for job in jobs]
        fields = call_collectively(comm, check_fields, output, fields, grids)
    rows = [None] * sum(len(job.loads) for job in jobs)
    jobs_by_solver = _sort_by_solver(jobs)
    with ExitStack() as stack:
        solver = stack.enter_context(closing(_ReusedSolver(LOADINGS[kind], fields, method, options, comm)))
        solver.set_up(jobs_by_solver[0].problem)  # raises for invalid options
        file_stack, files = stack.enter_context(ExitStack()), []
        if fields:

            def open_file():
                opened = open_field_stack(output, fields, len(rows), jobs[0].problem.grid)
                files.append(file_stack.enter_context(opened))

            call_collectively(comm, open_file, only_root=True)
        bar = None
        if progress:
            bar = stack.enter_context(progress_bar(comm.rank, total=len(jobs), desc="solve", unit="problem"))
        if processes == 1 or len(jobs) == 1:
            results = map(solver.solve, jobs_by_solver)
        else:
            solver.close()
            arguments = LOADINGS[kind], fields, method, options  # the class: its module is imported
            results = stack.enter_context(_on_processes(jobs_by_solver, min(processes, len(jobs)), arguments))
        for first_row, found in results:
            rows[first_row : first_row + len(found)] = [row for row, _ in found]
            if fields:
                call_collectively(comm, _write, files, first_row, found, only_root=True)
            if bar is not None:
                bar.update()
        table = SolutionTable(rows)
        if fields:
            call_collectively(comm, lambda: files[0].write_table(table.table), only_root=True)
            call_collectively(comm, file_stack.close, only_root=True)
    _warn(jobs, rows)
    return table


def _make_jobs(problems, loading, grid, material):
    """Check problems and loads; return the kind of loading and the jobs."""
    kind, numbers = single_loading(loading, "solve_many: ")
    problems = _as_problems(problems, grid, material)
    jobs, first_row = [], 0
    for number, (problem, values) in enumerate(
        zip(problems, _as_loads(kind, numbers, len(problems)), strict=True)
    ):
        LOADINGS[kind].check_grid(problem.grid)
        jobs.append(_Job(number, first_row, problem, values))
        first_row += len(values)
    return kind, jobs


def _as_problems(problems, grid, material):
    kind = type(problems).__name__
    is_map = isinstance(problems, np.ndarray) and problems.ndim == 2
    if is_map or isinstance(problems, Problem | str | bytes | Mapping) or hasattr(problems, "heights_on"):
        raise InputError(f"problems: is one {kind}; must be a sequence, [{'array' if is_map else '...'}]")
    try:
        problems = list(problems)
    except TypeError:
        raise InputError(f"problems: is {kind}; must be a sequence of ContactProblem or surfaces") from None
    if not problems:
        raise InputError("problems: is empty; must have one problem at least")
    has_grid = grid is not None or material is not None
    if has_grid and (grid is None or material is None):
        raise InputError(f"solve_many: surfaces need {'grid=' if grid is None else 'material='}, too")
    for number, problem in enumerate(problems):
        if isinstance(problem, Problem):
            if has_grid:
                raise InputError(
                    f"problems[{number}]: is a {type(problem).__name__}, which has its own grid and material; "
                    "give grid= and material= for surfaces only"
                )
        elif not has_grid:
            raise InputError(
                f"problems[{number}]: is {type(problem).__name__}; must be a ContactProblem, or a surface with "
                "grid= and material="
            )
        else:
            try:
                problems[number] = ContactProblem(grid, material, surfaces=[problem])
            except InputError as error:
                raise InputError(f"problems[{number}]: {error}") from None
    return problems


def _as_loads(kind, numbers, count):
    """Return `count` lists: the prescribed numbers of each problem.

    `numbers` is one number for all problems, a list with one number or one list for each problem, or [[...]], one list
    for all problems.
    """
    numbers = plain_number(numbers)
    if not hasattr(numbers, "__len__"):
        return [[validate_number(kind, numbers)]] * count
    entries = [] if isinstance(numbers, str | bytes | Mapping) else list(numbers)
    has_lists = [hasattr(entry, "__len__") and np.shape(entry) != () for entry in entries]
    if any(has_lists) and not all(has_lists):
        raise InputError(f"{kind}: has numbers and lists; must be numbers, or a list for each problem")
    if any(has_lists) and all(len(entry) for entry in entries):
        lists = [[validate_number(kind, number) for number in entry] for entry in entries]
        lists = lists * count if len(lists) == 1 else lists
    else:
        lists = [[validate_number(kind, number)] for number in entries] if not any(has_lists) else []
    if len(lists) != count:
        raise InputError(
            f"{kind}: {len(entries)} for {count} problems; must be a number, one for each problem, a list for each "
            f"problem, or one list for all, [[...]] [{LOADINGS[kind].unit}]"
        )
    return lists


def _check_processes(processes, jobs):
    check_type("processes", processes, Integral, "a number")
    if processes < 1:
        raise InputError(f"processes {processes}: must be at least 1")
    if processes == 1:
        return
    if MPI.COMM_WORLD.size > 1:
        raise InputError(
            f"processes {processes}: must be 1 under mpiexec with {MPI.COMM_WORLD.size} ranks, which share each problem"
        )
    for job in jobs:
        try:
            dumps(job.problem, HIGHEST_PROTOCOL)
        except (PicklingError, AttributeError, TypeError) as error:
            raise InputError(
                f"problems[{job.number}]: cannot be sent to a process ({format_message(error)}); {_REMEDY}"
            ) from None


def _sort_by_solver(jobs):
    """Return the jobs, sorted so that those of one solver are together."""
    groups = {}
    for job in jobs:
        bodies = job.problem.grid, job.problem.material, job.problem.surface_compliance
        try:
            groups.setdefault(bodies, []).append(job)
        except TypeError:  # a material with arrays
            groups.setdefault(tuple(map(id, bodies)), []).append(job)
    return [job for group in groups.values() for job in group]


class _ReusedSolver:
    """Solver that is set up again only for another grid, material or surface compliance."""

    def __init__(self, loading, fields, method=None, options=None, comm=None):
        self._kind, self._fields = loading.name, fields
        self._arguments = method, options, comm
        self._solver = None

    def close(self):
        """Free the solver."""
        if self._solver is not None:
            self._solver.close()
        self._solver = None

    def set_up(self, problem):
        """Make a solver for the bodies of a problem. Collective."""
        if self._solver is not None and self._solver.problem.fits(problem):
            return
        self.close()
        # Set-up does not need the shape. Errors of shapes concern one problem, those of set-up all of them.
        compliance = problem.surface_compliance
        plane = ContactProblem(problem.grid, problem.material, Plane(), surface_compliance=compliance)
        self._solver = ContactSolver(plane, *self._arguments)
        self._solver.quiet = True

    def solve(self, job):
        """Solve a job; return first row number, rows and fields. Collective."""
        try:
            self.set_up(job.problem)
            self._solver.update(job.problem)
        except InputError as error:
            return job.first_row, [(self._failed_row(job, load, error), None) for load in job.loads]
        return job.first_row, [self._solve(job, load) for load in job.loads]

    def _solve(self, job, load):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "not converged", RuntimeWarning)
            try:
                solution = self._solver.solve(**{self._kind: load})
                if job.problem.material.is_conducting:
                    solution = self._solver.with_stiffness(solution)
            except InputError as error:
                return self._failed_row(job, load, error), None
        row = {
            "problem": job.number,
            **numbers_of(solution),
            **solution.requested_numbers,
            "operator_applications": solution.operator_applications,
            "solve_seconds": solution.solve_seconds,
            "converged": solution.converged,
            "message": solution.message,
            "notes": "\n".join(solution.notes),
        }
        whole = solution.gather() if self._fields else None
        return row, whole and {name: getattr(whole, name) for name in self._fields}

    def _failed_row(self, job, load, error):
        numbers = dict.fromkeys(COLUMNS, np.nan) | {self._kind: load}
        message = format_message(error)
        return {"problem": job.number, **numbers, "converged": False, "message": message, "notes": ""}


def _write(files, first_row, found):
    for row, (_, fields) in enumerate(found, first_row):
        files[0].write(row, fields)


def _work(connection, arguments):
    """Solve chunks of jobs in a worker process.

    The process ends when the parent closes the connection.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the workers
    with closing(_ReusedSolver(*arguments)) as solver:
        while True:
            try:
                jobs = connection.recv()
            except EOFError:
                return
            except (AttributeError, ImportError) as error:
                connection.send(InputError(f"problems: {format_message(error)} in a process; {_REMEDY}"))
                return
            try:
                results = [solver.solve(job) for job in jobs]
            except Exception as error:
                error.add_note(f"in a process of solve_many:\n{format_exc()}")
                results = error
            try:
                connection.send(results)
            except (PicklingError, AttributeError, TypeError):
                connection.send(RuntimeError(format_error(results)))


@contextmanager
def _on_processes(jobs, count, arguments):
    """Yield an iterator over the finished jobs' results, in any order.

    The processes are spawned, because PETSc and MPI do not survive a fork. If the ``with`` block raises, the processes
    are killed. ProcessPoolExecutor is not used, because before Python 3.12 it waits forever if a process ends while it
    receives data.
    """
    size = max(1, min(MAX_CHUNK, len(jobs) // (CHUNKS_PER_PROCESS * count)))
    chunks = (jobs[k : k + size] for k in range(0, len(jobs), size))
    context, connections, processes = get_context("spawn"), [], []
    try:
        with temporary_environment(single_rank_variables(environ)), existing_folder():
            for _ in range(count):
                connection, far_end = context.Pipe()
                connections.append(connection)
                with far_end:
                    processes.append(context.Process(target=_work, args=(far_end, arguments), daemon=True))
                    processes[-1].start()
        yield _results(connections, chunks)
    except BaseException:
        for process in processes:
            if process.pid is not None:
                process.kill()
        raise
    finally:
        for connection in connections:
            connection.close()
        for process in processes:
            if process.pid is not None:
                process.join()


def _results(connections, chunks):
    """Yield results of jobs as processes finish; give them new jobs."""
    busy = set()

    def send(connection):
        if (chunk := next(chunks, None)) is not None:
            connection.send(chunk)
            busy.add(connection)

    try:
        for connection in connections:
            send(connection)
        while busy:
            for connection in wait([*busy]):
                results = connection.recv()
                busy.remove(connection)
                if isinstance(results, Exception):
                    raise results
                send(connection)
                yield from results
    except (EOFError, BrokenPipeError, ConnectionResetError):
        raise RuntimeError(
            "solve_many: a process has ended unexpectedly: for lack of memory, or because the program is no file that "
            'calls solve_many below `if __name__ == "__main__":`'
        ) from None


def _warn(jobs, rows):
    """Warn of failed problems, and of each kind of note once."""
    failed = [row for row in rows if not row["converged"]]
    if failed:
        numbers = list(dict.fromkeys(str(row["problem"]) for row in failed))
        names = ", ".join(numbers[:_MAX_NAMED]) + (", ..." if len(numbers) > _MAX_NAMED else "")
        warn_caller(
            f"{len(failed)} of {len(rows)} rows not converged, of problems {names}; the first: {failed[0]['message']}"
        )
    note_warnings = NoteWarnings()
    for job in jobs:
        for row in rows[job.first_row : job.first_row + len(job.loads)]:
            note_warnings.issue(job.problem, row["notes"].splitlines())
