"""Contact solver: set up once, solve often.

>>> from app import ContactProblem, Grid, Material, solve
>>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
>>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
>>> solution = solve(sphere, approach=0.01)
>>> solution.converged, round(solution.load, -1)
(True, 680.0)

Options are PETSc's and the options in `app.options.method`. Each solver puts its options into PETSc's database under a
prefix of its own, and only during set-up and solves.
"""

import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np

from app.api.analytic_values import analytic_values, theories
from app.api.arguments import check_disks, parse_arguments
from app.api.derivatives import Derivatives
from app.api.histories import Histories
from app.api.law import Laws
from app.api.layer_approach import add_uniform_displacement, search_approach
from app.api.notes import NoteWarnings, notes_on
from app.api.shifted_problem import BackgroundPressure
from app.api.slip import Friction
from app.api.solution import Solution, fingerprint
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, warn_caller
from app.base.numba_cache import clock, report_compilation
from app.base.petsc import Resources, mpi_comm, synchronized
from app.base.types import AnyComm, Method, Options, Prescribed
from app.base.usage import usage
from app.contact import measures
from app.contact.certificate import certify
from app.contact.contact_moments import measure_moments
from app.contact.distance import UndeformedDistance
from app.contact.history import History, Listener, Monitor
from app.contact.loading_input import USAGE
from app.contact.tilting_input import create_loading
from app.methods.strategy import STRATEGIES, allows_lists, check_single, make_strategy
from app.multigrid.hierarchy import Hierarchy, check_memory
from app.options.method import Settings, drop_unused
from app.options.option_table import describe_unknown_options, format_options
from app.options.solver_options import SolverOptions
from app.parallel import mpi_abort
from app.parallel.communicator import Communicator
from app.parallel.reductions import minimum_over
from app.problems.problem import Problem


@usage(f"solve(problem, {USAGE}")
def solve(
    problem: Problem,
    *,
    method: Method = None,
    options: Options = None,
    comm: AnyComm = None,
    start: Solution | None = None,
    **loading: Prescribed,
) -> Solution:
    """Solve a contact problem. Collective; raises the errors of `ContactSolver` and its `solve`.

    Parameters
    ----------
    problem : ContactProblem
    method, options, comm : optional
        Arguments of `ContactSolver`.
    start : Solution, optional
        Solution of a similar loading, from which the iteration starts.
    approach : float, optional
        Approach of the bodies [mm]. Give exactly one of the loadings, `app.contact.loading_input.LOADINGS`.
    load : float, optional
        Total force [N], at least 0.
    mean_pressure : float, optional
        Load over the area of the patch [N/mm2].
    mean_gap : float, optional
        Mean gap of a periodic patch without holes [mm]; with a hardness the mean of e = h + u.
    load_centre : (float, float), optional
        Centre of a load [mm], under which the bodies tilt; or `moment` or `tilt`, see docs/tilt.md.

    Returns
    -------
    Solution
        A RuntimeWarning is issued unless it is ``converged``, and a NoteWarning for each of its ``notes``.
    """
    with ContactSolver(problem, method, options, comm) as solver:
        return solver.solve(start=start, **loading)


class ContactSolver(Derivatives, Histories, Friction, Laws):
    """Solver of a contact problem for any loading.

    The constructor and all methods are collective over `comm`. `update` replaces the problem. The solver is freed at
    the end of a ``with`` block, by `close`, by garbage collection, or at the end of the process. Only one thread at a
    time may call a solver. A solver cannot be pickled; problems and solutions can.

    Parameters
    ----------
    problem : Problem
        `ContactProblem`, or another one of `app.problems`.
    method : str, or mapping of str to mapping, optional
        Name of a method file in petsc_options, such as "fmg_v11". Or several option files in order, a mapping from
        names to options. Default: the default method, unless the options choose a KSP or PC.
    options : mapping, optional
        Options by name without dash, such as {"lcp_rtol": 1e-8, "ksp_type": "cg"}. They override the method's options.
    comm : communicator of mpi4py or petsc4py, optional
        Ranks that share the grid; default: all. The solver works on a duplicate.
    prefix : str, optional
        Prefix of the solver's options in PETSc's database, such as ``"gear_"`` for ``-gear_ksp_view``. Options that you
        set under this prefix override the solver's. Default: ``"contact0_"``, ``"contact1_"``, ... With ``""``, options
        without a prefix are used, too.
    listeners : sequence of Listener
        Objects whose methods are called in every iteration.

    Attributes
    ----------
    settings : app.options.method.Settings
    options : SolverOptions
        Options that PETSc reads.
    setup_seconds : float
    touching : float
        Approach at which the bodies just touch [mm].
    hierarchy : Hierarchy
    quiet : bool
        If true, notes are not issued as warnings. Otherwise each kind of notes is issued once.
    ksp : PETSc.KSP or None
        Linear solver on the target grid. None if there is none, or if it works in a window that is not known yet.

    Raises
    ------
    InputError
        If an argument is not allowed, or there is not enough memory. Raised before any work, on all ranks.
    """

    settings: Settings
    options: SolverOptions
    setup_seconds: float
    touching: float
    hierarchy: Hierarchy

    @synchronized
    def __init__(
        self,
        problem: Problem,
        method: Method = None,
        options: Options = None,
        comm: AnyComm = None,
        prefix: str | None = None,
        listeners: Sequence[Listener] = (),
    ) -> None:
        started, comm = clock(), mpi_comm(comm)
        self._made_by = method, options, comm, None, listeners
        self._resources, self._distances = Resources(), []
        self._finalizer = weakref.finalize(self, synchronized(self._resources.free))
        self.problem, self._outer_comm = problem, mpi_abort.abort_on_exception(comm)
        self._resources.add(mpi_abort.AbortGroup(comm))
        self.comm = self._resources.comm = Communicator(self._outer_comm.Dup())
        self.hierarchy = self._strategy = None
        self._was_interrupted = self._late_options_checked = self.quiet = False
        self._note_warnings = NoteWarnings()
        try:
            if prefix is None:
                prefix = SolverOptions.new_prefix(self.comm)
            self.settings, self.options = call_collectively(
                self.comm, parse_arguments, problem, method, options, prefix, listeners
            )
            monitors = [Monitor()] if self.settings.monitor and self.comm.rank == 0 else []
            self.listeners, grid = [*listeners, *monitors], problem.grid
            # Processors may round differently.
            kernel = problem.kernel
            sizes = [f"{size:.6g}" for size in (grid.dx, grid.dy, *kernel.parameters)]
            arguments = grid.shape, grid.periodic, sizes, self.settings, prefix
            check_equal_on_ranks(self.comm, arguments, "grid, material or options")
            self.comm.shares_memory = self.settings.shared_memory
            lists = allows_lists(self.settings, problem)
            lists, more = check_memory(self.comm, problem, grid, self.settings, lists)
            call_collectively(self.comm, check_disks, self.settings.texts, grid.n, only_root=True)
            with self.options.inserted():
                self._set_up(lists, more)
            if unused := self.options.unused(self.comm):
                # Rank 0 has a part of every grid, and so reads most options.
                words = self.settings, unused, self.options.used
                self.settings = call_collectively(self.comm, drop_unused, *words, only_root=True)
                self.options.drop(unused)
            self._measure_shapes()
        except BaseException:
            self.close()
            raise
        self.setup_seconds = clock() - started

    def __repr__(self):
        grid, closed = self.problem.grid, "" if self._finalizer.alive else ", closed"
        return f"<ContactSolver: {grid.nx} x {grid.ny} cells{closed}>"

    def _set_up(self, lists, more_doubles):
        settings, grid, kernel = self.settings, self.problem.grid, self.problem.kernel
        self._uniform_compliance = kernel.uniform_compliance(grid)
        self._largest = None  # influence coefficient [mm3/N], needed for single precision
        if settings.single:
            self._largest = kernel.self_displacement(grid)
            check_single("influence coefficients", self._largest, "mm3/N")
        self.hierarchy = Hierarchy(
            grid, kernel, self.comm, settings.coarsest, settings.cells_per_rank,
            target_only=STRATEGIES[settings.type].target_only, dtype=np.float32 if settings.single else np.float64,
            margin=settings.window, prefix=self.options.prefix, compliance=self.problem.compliance,
            lists=lists, more_doubles=more_doubles,
        )  # fmt: skip
        self._resources.add(self.hierarchy)
        self._strategy = make_strategy(self.hierarchy, settings)
        self._resources.add(self._strategy)
        self._strategy.prepare()

    def _measure_shapes(self):
        """Compute the problem's undeformed distance on all grids."""
        hierarchy, problem, comm = self.hierarchy, self.problem, self.comm
        shapes, shift, step = hierarchy.shapes(problem), self._step, self._step
        if problem.background_pressure is not None:
            shift = BackgroundPressure(problem, hierarchy)
        if shift:
            shift.raise_shapes(shapes, hierarchy, self._own[1] if self._own[0] is problem else None)
        target = shapes[-1]
        lowest, highest = np.nanmin(target, initial=np.inf), np.nanmax(target, initial=-np.inf)
        lowest, highest = minimum_over(comm, [lowest, -highest]) * (1, -1)
        if lowest > highest:
            raise InputError(f"problem {problem.name}: contact is impossible in all cells (NaN)")
        if self.settings.single:
            check_single("pressures", max(-lowest, highest) / self._largest, "N/mm2")
        reference = float(lowest)
        indentation = measures.measure_indentation(problem.indentation, target, hierarchy.slabs, comm)
        for shape in shapes:
            shape -= reference
        coarse_minimum = hierarchy.coarse_minimum(shapes)
        hardness = hierarchy.hardness(shift.hardness if shift else problem.hardness)
        del target, shape
        distances = UndeformedDistance.on_levels(hierarchy.levels, shapes, reference, comm, hardness)
        roughness = shift.roughness if shift else None
        roughness = roughness or measures.measure_roughness(hierarchy.target, distances[-1])
        # From here on nothing fails.
        before, self._distances = self._distances, distances
        self.touching, self._roughness = step.touching if step else reference, roughness
        self._indentation, self._shift, self._measured_step = indentation, shift, step
        self._own = problem, (shift.touching if shift else reference, roughness)
        self._strategy.use_distances(distances, coarse_minimum)
        for distance in distances:
            self._resources.add(distance)
        for distance in before:
            self._resources.remove(distance)

    @property
    def ksp(self) -> Any:
        """Linear solver (KSP) on the target grid, or None."""
        return getattr(self._strategy and self._strategy.solver, "ksp", None)

    @usage(f"solver.solve({USAGE}")
    @synchronized
    def solve(self, *, start: Solution | None = None, **loading: Prescribed) -> Solution:
        """Solve for a prescribed quantity.

        Parameters
        ----------
        start : Solution, optional
            Solution of the same grid and communicator and of a similar loading, from which the iteration starts.
        **loading : float
            Prescribed quantity, see `app.solve`. Give exactly one.

        Returns
        -------
        Solution
            A RuntimeWarning is issued unless it is ``converged``, and a NoteWarning for each of its ``notes``.

        Raises
        ------
        InputError
            If the loading is not allowed, or PETSc finds the chosen solvers incompatible.
        """
        self._check_open()
        mpi_abort.abort_on_exception(self._outer_comm)
        check_equal_on_ranks(self.comm, (loading, fingerprint(start)), "loading or start")
        with ExitStack() as stack:
            for listener in self.listeners:
                listener.begin(self.settings)
                stack.callback(listener.end)
            solution = self._note_late_options(self._solve(loading, start))
            if more := self.problem.measure(solution):
                solution = replace(solution, problem=solution.problem | more)
            if self.problem.material.is_conducting and not self.quiet:
                solution = self.with_stiffness(solution)
        report_compilation()
        if not solution.converged:
            warn_caller(f"not converged: {solution.message}")
        if not self.quiet:
            self._note_warnings.issue(self.problem, solution.notes)
        return solution

    def _note_late_options(self, solution):
        """Add a note on options that the first linear solves left unused."""
        if self._late_options_checked or not sum(solution.history.get("inner_iterations", ())):
            return solution
        self._late_options_checked = True
        unused = set(self.options.unused(self.comm, late=True)).difference(self.settings.replaceable)
        if not unused:
            return solution
        return replace(solution, notes=(*solution.notes, describe_unknown_options(unused, (), "unused")))

    def _solve(self, values, start):
        if self._was_interrupted or self._step is not self._measured_step:  # maybe in an update
            self.hierarchy.collect_garbage()
            self._was_interrupted = True
            self._measure_shapes()
            self._was_interrupted = False
        loading, uniform = self._make_loading(values), self._uniform_compliance
        if start is not None:
            self._check_solution(start, "start")
            start = self._shift.net(start) if self._shift else start
        if not uniform or loading.kind != "approach" or loading.misses_contact(self._distances[-1]):
            solution = self._solve_loading(loading, start)
        else:
            solve, distance = partial(self._solve_loading, start=start), self._distances[-1]
            solution = search_approach(solve, self.problem, distance, loading.approach, self.settings)
        solution = self._shift.add_to(solution, values) if self._shift else solution
        return add_uniform_displacement(solution, uniform) if uniform else solution

    def _solve_loading(self, loading, start):
        started, traffic = clock(), self.comm.count_traffic()
        products = self.hierarchy.operator_applications()
        self._strategy.check_loading(loading, self._largest)
        if loading.misses_contact(self._distances[-1]):
            start = None  # there is no pressure
        history, self._was_interrupted = History(self.listeners), True
        with self.options.inserted():
            state, outcome = self._strategy.run(loading, history, start)
            self._was_interrupted = False
            try:
                return self._solution(state, loading, outcome, history, started, products, traffic)
            finally:
                state.destroy()

    @synchronized
    def update(self, problem: Problem) -> None:
        """Replace the problem; grid, material and surface compliance stay the same.

        Solutions of the old problem stay valid, and one may be the `start` of a solve. Raises InputError if one of the
        three differs, or if contact is impossible in all cells; the solver then keeps the old problem.
        """
        self._check_open()
        before, fits = self.problem, self.problem.fits(problem)
        check_equal_on_ranks(self.comm, fits, "grid or material")
        if not fits:
            same = "grid, material and surface compliance"
            raise InputError(f"problem: must be a ContactProblem of the solver's {same}")
        self.problem = problem
        try:
            self._measure_shapes()
        except BaseException:
            self.problem, self._was_interrupted = before, True
            raise

    def _check_open(self):
        if not self._finalizer.alive:
            raise InputError("the solver is closed")

    def _make_loading(self, values):
        if self._shift:
            values = self._shift.net_loading(values, self._distances[-1].bounds.largest_load)
        uniform = self._uniform_compliance
        loading = create_loading(self._distances, uniform, self.comm, values, not self._shift)
        if self._shift and values.get("approach") is not None:
            loading.approach -= self._shift.uniform
        return loading

    def _solution(self, state, loading, outcome, history, started, products, traffic):
        proof = certify(state, self.settings.error_bound)  # may take a product
        applied, seconds = self.hierarchy.operator_applications() - products, clock() - started
        measured = measures.measure_contact(state)
        if measured.contact_cells and not measured.max_pressure:
            state.contact[...] = False  # bodies that just touch have no contact area
            measured = measures.measure_contact(state)
        proof = proof.under(loading.load, measured.load, loading.moment_error(state))
        outcome = outcome.require_bound(proof.error_bound, self.settings.error_bound)
        errors = outcome.grid_errors.add_contact_edge(measured, outcome.discretisation_error, self.problem)
        before = self._indentation
        measured = loading.restore_prescribed(measured).add_indentation(before, state)
        distance, depth, tilt = state.distance, state.depth, state.distance.tilt
        approach, moments = loading.solved_approach(state), measure_moments(state)
        total = self._shift.total(measured, state) if self._shift else measured
        notes = notes_on(state, self.problem, total, moments, self._roughness)
        # Rank 0 has a part of every grid and window.
        counted = applied, history.entries, self.comm.count_traffic().since(traffic)
        (applied, history.entries, traffic), top = self.comm.bcast(counted), len(self.hierarchy.levels) - 1
        return Solution(
            pressure=state.p,
            deformation=state.deformation(),
            distance=synchronized(lambda: before.remove_from(distance.h_at(depth, tilt))),
            contact=state.in_contact().copy(),
            plastic=state.bounds.plastic(state.p),
            indentation_before=before.depth,
            extra=self.problem.fields(self.hierarchy.slabs.rows),
            converged=outcome.converged,
            message=outcome.reason,
            prescribed=loading.kind,
            approach=approach,
            tilt_x=tilt.x,
            tilt_y=tilt.y,
            indentation=depth - state.first_touch() + before.approach,
            residual=outcome.residual,
            iterations=outcome.iterations,
            inner_iterations=sum([e["inner_iterations"] for e in history.entries if e["level"] == top]),
            work_units=sum([entry["work_units"] for entry in history.entries]),
            operator_applications=applied,
            discretisation_error=outcome.discretisation_error,
            **errors._asdict(),
            fallbacks=outcome.fallbacks,
            **measured._asdict(),
            **moments._asdict(),
            rms_height=self._roughness.rms_height,
            rms_slope=self._roughness.rms_slope,
            rtol=self.settings.rtol,
            certificate=proof,
            history=history.columns(),
            problem=self.problem.describe()
            | state.bounds.describe()
            | analytic_values(self.problem, measured, approach, loading)
            | theories(self.problem, measured.mean_pressure, self._roughness.rms_slope),
            options=format_options(self.settings.texts),
            notes=(*self.settings.warnings, *notes),
            solve_seconds=seconds,
            setup_seconds=self.setup_seconds,
            traffic=traffic,
            grid=self.problem.grid,
            slabs=self.hierarchy.slabs,
            comm=self._outer_comm,
        )

    def close(self) -> None:
        """Free grids and solvers; solutions stay valid. Collective."""
        self._finalizer()

    def __reduce__(self):
        raise TypeError("a ContactSolver cannot be pickled; its problem can, and solutions")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
