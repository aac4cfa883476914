"""The solve of app.solve, until the solver for programs takes its place."""

from __future__ import annotations

import gc
import re
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app import __version__
from app.commands import session
from app.commands.problem_options import PROBLEM_OPTIONS, check_memory, input_files, loading, make_problem
from app.commands.report import report
from app.errors import InputError, agree
from app.options import METHOD_OPTIONS, OptionReader
from app.petsc import OptionDatabase, error_message

_DOUBTFUL = 1e-2  # error bound of the certificate from which on the user should look twice
_NEED_ENTRIES = ("hypre", "hmg", "kaczmarz", "redistribute")  # and crash without
# PETSc's errors that say that types do not go together: unsupported, wrong argument or state, method missing, unknown
# type, no factorisation
_WRONG_CHOICES = (56, 60, 62, 73, 75, 83, 86, 92)
METHODS = Path(__file__).resolve().parents[2] / "petsc_options"
# Options that PETSc looks up only while solving or at the end, or never marks as used.
_READ_LATE = re.compile(r"(\w+_)?(ksp|snes|tao)_converged_reason|(\w+_)?(ksp|pc|mat|vec|snes|tao)_view\w*")


class Options(OptionReader):
    """Options of the tables, and a private database in which PETSc finds them and its own."""

    def __init__(self, given):
        super().__init__([*PROBLEM_OPTIONS, *METHOD_OPTIONS], given.texts)
        self.sources = given
        self.texts = dict(given.texts)
        self.database = OptionDatabase(given.texts)

    def given(self, name):
        """Whether any option is set."""
        return name in self.texts

    def text(self, name):
        """Text of any option, PETSc's own too; empty if not set. Not collective."""
        return self.texts.get(name, "")

    def set(self, name, text):
        """Set an option as if the user had. Not collective."""
        self.texts[name] = self._texts[name] = text
        self.database.set(name, text)

    def loading(self):
        """What is prescribed, and which option says so."""
        kind, value = loading(self.sources)
        for name in {"approach", "load"} - {kind}:
            self.texts.pop(name, None)
            self.database.drop(name)
        self.asked.add(kind)
        return kind, value

    def nobody_wants(self, own=()):
        """Names of options that neither this program nor PETSc has asked for so far, but for the `own` of a problem."""
        left = [name for name in self.database.unused() if not _READ_LATE.fullmatch(name)]
        return sorted(set(left) - self.asked - set(own))

    def summary(self):
        """All options that are set, as one text. Not collective."""
        return " ".join(f"-{name} {self.texts[name]}".strip() for name in sorted(self.texts))


def run(options):
    """Solve, write, report; return the exit status. Collective."""
    from petsc4py import PETSc

    comm = MPI.COMM_WORLD
    started = time.perf_counter()
    with PETSc.Log.Stage("Setup"):
        setup = prepare(options, comm)
    from app.contact.certificate import certify
    from app.contact.loop import History

    gc.freeze()  # all this stays: looking for garbage in it takes as long as a small solve
    setup_seconds = time.perf_counter() - started
    history = History(setup.listeners)
    started = time.perf_counter()
    with PETSc.Log.Stage("Solve"):
        state, outcome = solve(setup, history)
    solve_seconds = time.perf_counter() - started
    for listener in setup.listeners:
        listener.end()

    facts = _facts(setup, state, outcome, history, comm)
    setup.free_solver()
    setup.hierarchy.keep_only_the_answer()
    facts |= certify(state).describe()
    peak = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    facts.update(setup_seconds=setup_seconds, solve_seconds=solve_seconds, ranks=comm.size, peak_memory=peak)
    with PETSc.Log.Stage("Output"):
        if setup.output:
            _write(setup, state, facts, history, comm)
    session.say(report(facts, setup.problem.grid.nx, setup.problem.grid.ny, setup.output))
    if _touches_rim(state, comm):
        what = "contact reaches" if facts["contact_cells"] else "the smallest distance is found at"
        session.warn(f"{what} the rim of the patch: enlarge -domain if the bodies go on beyond it")
    if outcome.converged and facts["error_bound"] > _DOUBTFUL and not setup.controls.cheap:
        session.warn(
            f"the certificate only proves the pressure to {facts['error_bound']:.1g}: contact is small against the "
            "patch, or some cells are very far apart; a smaller -lcp_rtol is more accurate"
        )
    state.destroy()
    return 0 if outcome.converged else 3


class prepare:
    """Everything that can be refused before any work: problem, grids, solver, output. Collective."""

    nested, beta, prolongation, margin = False, 0.0, "copy", 0.0  # of the active set's methods only

    def __init__(self, options, comm):
        from app.commands.monitor import Monitor, Progress
        from app.contact import kernels, nested  # noqa: F401  (imported before the solve is timed)
        from app.contact.loading import PrescribedApproach, PrescribedLoad
        from app.contact.loop import Controls
        from app.halfspace.influence import influence_quadrant
        from app.halfspace.sweeps import gauss_seidel
        from app.multigrid import transfer
        from app.multigrid.circulant import circulant_of
        from app.multigrid.hierarchy import Hierarchy
        from app.output.result import check_output_path

        self.output = options["output"]
        if self.output:
            read = [*options.sources.files, *input_files(options)]
            agree(comm, check_output_path, self.output, read)
        self.problem, own, notes = agree(comm, make_problem, options, options.texts, comm)
        for line in notes:
            session.warn(line)
        agree(comm, check_memory, self.problem.grid, comm)
        self.loading = make_loading(*options.loading())
        self.type = options["lcp_type"]
        self.controls = Controls(rtol=options["lcp_rtol"], max_it=options["lcp_max_it"])
        refuse_what_needs_entries(options)
        if self.type == "active_set":
            self._read_method(options)
        else:
            refuse_what_needs_operators(options, self.type)
        self.listeners = [Monitor()] if options["lcp_monitor"] else []
        if not self.listeners and comm.rank == 0 and sys.stderr.isatty():
            self.listeners.append(Progress(self.controls.rtol))

        by_load = isinstance(self.loading, PrescribedLoad)
        just_touching = by_load and self.loading.load == 0
        if just_touching:
            self.nested, self.margin = False, 0.0  # there is no pressure to be found on coarser grids
        if by_load and self.type != "active_set":
            raise InputError(f"-lcp_type {self.type}: works with -approach only, not with -load")
        multilevel = self.type == "active_set" and (self.nested or by_load or options.text("pc_type") == "mg")
        grid, compliance = self.problem.grid, self.problem.material.compliance
        in_single = options["lcp_precision"] == "single"
        if in_single:
            largest = float(influence_quadrant(grid, compliance, slice(0, 1), 1)[0, 0])
            check_single("influence coefficients", largest, "mm3/N")
        self.hierarchy = Hierarchy(
            grid, compliance, comm, options["lcp_coarsest"], options["lcp_replicate"] ** 2,
            single=not multilevel,
            dtype=np.float32 if in_single else np.float64,
            margin=self.margin,
        )  # fmt: skip
        self.solver = make_solver(self.type, self.hierarchy, self.controls)
        kernels.load()
        kind = options.text("pc_type")
        if kind == "sor" or (kind == "mg" and options.text("mg_levels_pc_type") in ("", "sor")):
            gauss_seidel.warm_up()
        transfer.load()
        if self.prolongation == "lift" and self.nested:
            for operator in self.hierarchy.levels:
                if not self.hierarchy.windowed(operator):
                    circulant_of(operator)
        unused = options.nobody_wants(own.asked)
        if unused:
            self.free_solver()
            raise InputError(
                f"unknown or unused option{'s'[: len(unused) > 1]}: -{', -'.join(sorted(unused))}"
            )
        self.shapes = self.hierarchy.shapes(self.problem)
        self.lowest = self.hierarchy.lowest(self.shapes)
        if in_single:
            highest = comm.allreduce(float(np.nanmax(np.abs(self.shapes[-1]), initial=0.0)), MPI.MAX)
            check_single("pressures", highest / largest, "N/mm2")
        if not comm.allreduce(int(np.count_nonzero(~np.isnan(self.shapes[-1])))):
            raise InputError(f"-problem {self.problem.name}: contact is impossible in all cells (NaN)")
        if just_touching:
            # The approach is not unique: the one at which the bodies just touch.
            lowest = np.nanmin(self.shapes[-1], initial=np.inf)
            self.loading = PrescribedApproach(comm.allreduce(float(lowest), MPI.MIN))
        self.options_text = options.summary()

    def _read_method(self, options):
        """Take the options of the active set iteration."""
        use_default_method(options)
        self.controls = replace(
            self.controls,
            coarse_rtol=options["lcp_coarse_rtol"],
            merge=options["lcp_merge"],
            foresight=options["lcp_foresight"],
            cheap=options["lcp_cheap"],
        )
        self.nested, self.beta = options["lcp_nested"], options["lcp_beta"]
        self.prolongation, self.margin = options["lcp_prolongation"], options["lcp_window"]
        if self.margin and not self.nested:
            raise InputError("-lcp_window: is found on coarser grids; allowed with -lcp_nested only")
        if self.margin and options.text("pc_type") == "mg":
            raise InputError("-lcp_window: the levels of -pc_type mg are whole grids; not allowed with it")
        if self.controls.cheap and not self.nested:
            raise InputError("-lcp_cheap: estimates errors from two grids; allowed with -lcp_nested only")

    def free_solver(self):
        """Free the solver of the target grid, if there is one. Collective."""
        if self.solver:
            self.solver.destroy()


def check_single(what, value, unit):
    """Refuse what single precision has no numbers for."""
    if value and not 1e-25 < value < 1e25:
        raise InputError(
            f"-lcp_precision single: {what} of {value:.0e} {unit} are beyond it; choose -lcp_precision double, "
            "or units nearer to the bodies'"
        )


def make_loading(kind, value):
    """Turn what the options prescribe into a loading."""
    from app.contact.loading import PrescribedApproach, PrescribedLoad

    if kind == "approach":
        return PrescribedApproach(value)
    return PrescribedLoad(value)


def use_default_method(options):
    """Take the solver of fast.opts if the options choose none."""
    if options.given("ksp_type") or options.given("pc_type"):
        return
    needs_nesting = ("lcp_window", "lcp_prolongation", "lcp_coarse_rtol")
    nested = not options.given("lcp_nested") or options["lcp_nested"]
    for line in (METHODS / "fast.opts").read_text().splitlines():
        name, _, value = line.partition("#")[0].strip().removeprefix("-").partition(" ")
        if name and not options.given(name) and (nested or name not in needs_nesting):
            options.set(name, value.strip())


def refuse_what_needs_entries(options):
    """Refuse preconditioners that crash where a matrix can only be multiplied."""
    for name, value in options.texts.items():
        if name.endswith("pc_type") and value in _NEED_ENTRIES:
            raise InputError(f"-{name} {value}: needs the entries of the matrix, which are never stored")


def refuse_what_needs_operators(options, kind):
    """Refuse solvers that need this program's operators, where PETSc works on parts of them."""
    given = options.texts
    for name in ("ksp_python_type", "pc_python_type", "pc_type"):
        value = given.get(name, "")
        if value.startswith("app.") or value == "mg":
            raise InputError(f"-{name} {value}: works with active_set only, not with -lcp_type {kind}")


def make_solver(kind, hierarchy, controls):
    """Set up the solver of the target grid; what PETSc refuses is the user's to know.

    Returns
    -------
    LinearSolver or a competitor
        None if the target grid is worked on in a window, whose solver is made when that is known: then the options
        have been tried on a smaller grid.
    """
    from petsc4py import PETSc

    from app.contact.competitors import COMPETITORS
    from app.multigrid.linear_solver import LinearSolver

    try:
        if kind != "active_set":
            return COMPETITORS[kind](hierarchy, controls)
        if not hierarchy.windowed(hierarchy.target):
            return LinearSolver(hierarchy)
        level = hierarchy.lookout
        LinearSolver(hierarchy, level, hierarchy.levels[level].petsc_comm).destroy()
        return None
    except PETSc.Error as error:
        raise InputError(f"solver options: {error_message(error)}") from None
    except (ValueError, ImportError, AttributeError) as error:
        raise InputError(f"solver options: {error}") from None


def solve(setup, history):
    """Solve the problem that was set up; return the state of the target grid and the outcome. Collective."""
    from petsc4py import PETSc

    from app.contact import nested
    from app.contact.active_set import ContactGrid

    if setup.type != "active_set":
        target = setup.hierarchy.target
        state = ContactGrid(target, setup.shapes[-1])
        setup.loading.start(state)
        try:
            return state, setup.solver.solve(state, history)
        except PETSc.Error as error:
            if error.ierr not in _WRONG_CHOICES:
                raise
            raise InputError(f"-lcp_type {setup.type}: {error_message(error)}") from None
    return nested.solve(
        setup.hierarchy,
        setup.shapes,
        setup.loading,
        setup.controls,
        history,
        nested=setup.nested,
        beta=setup.beta,
        prolongation=setup.prolongation,
        target_solver=setup.solver,
        lowest=setup.lowest,
    )


def _facts(setup, state, outcome, history, comm):
    """Root attributes of the result file; complete on rank 0. Collective."""
    p = state.pressure
    rows = [entry for entry in history.entries if entry["level"] == len(setup.hierarchy.levels) - 1]
    cells = int(state.sum([state.contact.sum()])[0])
    return {
        "converged": outcome.converged,
        "reason": outcome.reason,
        "active_set_iterations": outcome.iterations,
        "inner_iterations": sum(entry["inner_iterations"] for entry in rows),
        "work_units": sum(entry["work_units"] for entry in history.entries),
        "operator_applications": setup.hierarchy.operator_applications(),
        "residual": outcome.residual,
        "discretisation_error": outcome.discretisation_error,
        "load": state.load,
        "approach": state.approach,
        "max_pressure": p.max()[1],
        "contact_cells": cells,
        "contact_fraction": cells / state.admissible_cells,
        "lcp_rtol": setup.controls.rtol,
        **setup.problem.describe(),
        "options": setup.options_text,
        "command_line": " ".join(sys.argv),
        "version": __version__,
    }


def _write(setup, state, facts, history, comm):
    from app.output.result import write_result

    grid, slabs = setup.problem.grid, setup.hierarchy.slabs
    h = np.where(state.admissible, state.shape - state.approach, np.nan)
    fields = {
        "pressure": state.pressure.getArray(readonly=True).reshape(h.shape),
        "gap": h + state.u,
        "displacement": state.u,
        "undeformed_distance": h,
        "contact": state.contact.astype(np.uint8),
    }
    columns = history.columns()
    try:
        write_result(setup.output, comm, slabs, fields, grid.x(), grid.y(), facts, columns)
    except OSError as error:
        raise InputError(f"-output {setup.output}: cannot be written: {error}") from None


def _touches_rim(state, comm):
    """Whether a cell on the rim of the patch is in contact, or is nearest to it if there is none. Collective."""
    if state.in_contact():
        cells = state.contact
    else:
        shape = np.where(state.admissible, state.shape, np.inf)
        cells = shape == comm.allreduce(float(shape.min(initial=np.inf)), MPI.MIN)
    rows = state.operator.slabs.rows
    touches = cells[:, [0, -1]].any()
    if cells.size:
        touches |= rows.start == 0 and cells[0].any()
        touches |= rows.stop == state.grid.ny and cells[-1].any()
    return comm.allreduce(bool(touches), MPI.LOR)
