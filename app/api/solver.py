"""The solver as a program calls it: set up once, solve as often as wanted, on any communicator.

>>> from app import ContactProblem, Grid, Material, solve
>>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
>>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / (2 * 20))
>>> solution = solve(sphere, approach=0.01)
>>> solution.converged, round(solution.load, -1)
(True, 680.0)

Options are PETSc's and those of `app.options.method`. Each solver has them under a prefix of its own in
PETSc's database, and only while it is set up or solves.
"""

from __future__ import annotations

import time
import weakref
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from app.api.analytic_values import analytic_values, theories
from app.api.load_path import LoadPath, exactly_one
from app.api.method_solver import make_hierarchy, make_strategy, parse_method
from app.api.notes import notes_on
from app.api.solution import Solution, identity
from app.api.stiffness import contact_stiffness
from app.api.strategy import check_single
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, warn_caller
from app.base.petsc import Resources, mpi_comm, synchronized
from app.contact import measures
from app.contact.certificate import certify
from app.contact.contact_moments import measure_moments
from app.contact.distance import UndeformedDistance
from app.contact.history import History, Monitor
from app.contact.loading_input import make_loading
from app.halfspace.influence import influence_quadrant
from app.multigrid.hierarchy import check_room
from app.options.method import drop_unused
from app.options.option_table import describe_unknown_options, format_options
from app.options.solver_options import SolverOptions
from app.parallel import mpi_abort
from app.parallel.communicator import Communicator
from app.parallel.reductions import minimum_over


def solve(
    problem, *, approach=None, load=None, method=None, options=None, comm=None, start=None,
    mean_pressure=None, mean_gap=None,
):  # fmt: skip
    """Solve a contact problem once, for exactly one of approach, load, mean pressure and mean gap.

    Collective over `comm`. More about each, and what is refused: `ContactSolver`, `ContactSolver.solve`.

    Parameters
    ----------
    problem : ContactProblem
    approach : float, optional
        [mm]
    load : float, optional
        Total force [N], at least 0.
    mean_pressure : float, optional
        Load over the area of the patch [N/mm2].
    mean_gap : float, optional
        Of a periodic patch without holes [mm].
    method : str or mapping, optional
        Name of a method file, such as "fmg_v11".
    options : mapping, optional
        Names, without dash, to values: {"lcp_rtol": 1e-8}.
    comm : communicator of mpi4py or petsc4py, optional
        Ranks that share the grid; default: all.
    start : Solution, optional
        To start from: of a similar loading.

    Returns
    -------
    Solution
        If it is not ``converged``, there is a warning, too.
    """
    with ContactSolver(problem, method, options, comm) as solver:
        return solver.solve(
            approach=approach, load=load, start=start, mean_pressure=mean_pressure, mean_gap=mean_gap
        )


class ContactSolver:
    """Solves one problem for any approach or load, and others on the same cells after an `update`.

    Collective over `comm`, as are all its methods. May be used in a ``with`` block; if it is not closed, it is freed
    when it is forgotten, or at the end of the process. Threads wait for each other. It cannot be pickled; problems and
    solutions can.

    Parameters
    ----------
    problem : Problem
        `ContactProblem`, or another one of `app.problems`.
    method : str, or mapping of str to mapping, optional
        Name of a method file in petsc_options, such as "fmg_v11"; or option files in order, a mapping of name ->
        options. Default: the default method, unless the options choose a KSP or PC.
    options : mapping, optional
        Options without dash, texts or numbers: {"lcp_rtol": 1e-8, "ksp_rtol": 0.1}. They override the file's.
    comm : communicator of mpi4py or petsc4py, optional
        Ranks that share the grid; default: all. One of its own is made, and freed.
    prefix : str, optional
        Of the solver's options in PETSc's database, such as "gear_" for ``-gear_ksp_view``; those of the user override.
        Default: "contact0_", "contact1_", ... in order. With "" PETSc's options without a prefix count, too.
    listeners : sequence of Listener
        Hear of every iteration.

    Attributes
    ----------
    settings : app.options.method.Settings
    options : SolverOptions
        Those that PETSc reads.
    setup_seconds : float
    touching : float
        Approach at which the bodies just touch [mm].
    hierarchy : Hierarchy
    ksp : PETSc.KSP or None
        Of the target grid; None where it is only made in a window, or there is none.

    Raises
    ------
    InputError
        If something asked for cannot be done; before any work, on all ranks.
    """

    @synchronized
    def __init__(self, problem, method=None, options=None, comm=None, prefix=None, listeners=()):
        started, comm = time.perf_counter(), mpi_comm(comm)
        self._resources, self._distances = Resources(), []
        self._finalizer = weakref.finalize(self, synchronized(self._resources.free))
        self.problem, self._outer_comm = problem, mpi_abort.abort_on_exception(comm)
        self._resources.add(mpi_abort.AbortGroup(comm))
        self.comm = self._resources.comm = Communicator(self._outer_comm.Dup())
        self.hierarchy, self._strategy, self._cut_short = None, None, False  # was the last call?
        self._judged = False  # the options that PETSc reads while it solves
        try:
            if prefix is None:
                prefix = SolverOptions.new_prefix(self.comm)
            chosen, self.options = call_collectively(
                self.comm, parse_method, problem, method, options, prefix, listeners
            )
            self.settings = chosen
            monitors = [Monitor()] if chosen.monitor and self.comm.rank == 0 else []
            self.listeners, grid = [*listeners, *monitors], problem.grid
            # Processors may round differently.
            sizes = [f"{size:.6g}" for size in (grid.dx, grid.dy, problem.material.compliance)]
            check_equal_on_ranks(
                self.comm, (grid.shape, grid.periodic, sizes, chosen, prefix), "grid, material or options"
            )
            self.comm.shares_memory = chosen.shared_memory
            check_room(self.comm, grid, chosen)
            self._prepare()
        except BaseException:
            self.close()
            raise
        self.setup_seconds = time.perf_counter() - started

    def __repr__(self):
        grid, closed = self.problem.grid, "" if self._finalizer.alive else ", closed"
        return f"<ContactSolver: {grid.nx} x {grid.ny} cells{closed}>"

    def _prepare(self):
        """Make all that solves."""
        with self.options.inserted():
            self._set_up()
        if unused := self.options.unused(self.comm):
            # Rank 0 has a part in every grid, and so knows most names.
            words = self.settings, unused, self.options.used
            self.settings = call_collectively(self.comm, drop_unused, *words, only_root=True)
            for name in unused:
                self.options.drop(name)
        self._measure_shapes()

    def _set_up(self):
        chosen, problem = self.settings, self.problem
        grid, compliance = problem.grid, problem.material.compliance
        self._largest = None  # influence coefficient, which only single precision asks for [mm3/N]
        if chosen.single:
            alone = replace(grid, periodic="")  # images change little of a cell's influence on itself
            self._largest = float(influence_quadrant(alone, compliance, slice(0, 1), 1)[0, 0])
            check_single("influence coefficients", self._largest, "mm3/N")
        self.hierarchy = hierarchy = make_hierarchy(grid, compliance, self.comm, chosen, self.options.prefix)
        self._resources.add(hierarchy)
        self._strategy = make_strategy(hierarchy, chosen)
        self._resources.add(self._strategy)
        self._strategy.prepare()

    def _measure_shapes(self):
        """Undeformed distance on all grids."""
        hierarchy, problem, comm = self.hierarchy, self.problem, self.comm
        shapes = hierarchy.shapes(problem)
        target = shapes[-1]
        lowest, highest = np.nanmin(target, initial=np.inf), np.nanmax(target, initial=-np.inf)
        lowest, highest = minimum_over(comm, [lowest, -highest]) * (1, -1)
        if lowest > highest:
            raise InputError(f"problem {problem.name}: contact is impossible in all cells (NaN)")
        if self.settings.single:
            check_single("pressures", max(-lowest, highest) / self._largest, "N/mm2")
        reference = float(lowest)
        for shape in shapes:
            shape -= reference
        coarse_minimum = hierarchy.coarse_minimum(shapes)
        distances = UndeformedDistance.on_levels(hierarchy.levels, shapes, reference, comm)
        roughness = measures.measure_roughness(hierarchy.target, distances[-1], target)
        before, self._distances = self._distances, distances  # which are complete
        self.touching, self._roughness = reference, roughness
        self._strategy.use_distances(distances, coarse_minimum)
        for distance in distances:
            self._resources.add(distance)
        for distance in before:
            self._resources.remove(distance)

    def _mend(self):
        """After a call that was cut short: an update may have come half way."""
        if self._cut_short:
            self.hierarchy.collect_garbage()
            self._measure_shapes()
            self._cut_short = False

    @property
    def ksp(self):
        """KSP of the target grid, or None. Not collective."""
        return getattr(self._strategy and self._strategy.solver, "ksp", None)

    @synchronized
    def solve(self, *, approach=None, load=None, start=None, mean_pressure=None, mean_gap=None):
        """Solve for exactly one of approach, load, mean pressure and mean gap.

        Parameters
        ----------
        approach : float, optional
            [mm]
        load : float, optional
            Total force [N], at least 0.
        start : Solution, optional
            Of the same grid and communicator, to start from: for a similar loading.
        mean_pressure : float, optional
            Load over the area of the patch [N/mm2].
        mean_gap : float, optional
            Of a periodic patch without holes [mm].

        Returns
        -------
        Solution
            If it is not ``converged``, there is a warning, too.

        Raises
        ------
        InputError
            If the loading is not allowed, or PETSc finds that the chosen solvers do not go together.
        """
        self._refuse_if_closed()
        given = {"approach": approach, "load": load, "mean_pressure": mean_pressure, "mean_gap": mean_gap}
        mpi_abort.abort_on_exception(self._outer_comm)
        check_equal_on_ranks(self.comm, (given, identity(start)), "loading or start")
        with ExitStack() as to_end:
            for listener in self.listeners:
                listener.begin(self.settings)
                to_end.callback(listener.end)
            solution = self._solve(given, start)
        solution = self._judge_late_options(solution)
        if not solution.converged:
            warn_caller(f"not converged: {solution.message}")
        return solution

    def _judge_late_options(self, solution):
        """Note options that the first solve of linear systems has left unused; some are read in it only."""
        if self._judged or not sum(solution.history.get("inner_iterations", ())):
            return solution
        self._judged = True
        unused = set(self.options.unused(self.comm, late=True)).difference(self.settings.replaced)
        if not unused:
            return solution
        return replace(solution, notes=(*solution.notes, describe_unknown_options(unused, (), "unused")))

    def _solve(self, given, start):
        started, before = time.perf_counter(), self.comm.traffic.copy()
        products = self.hierarchy.operator_applications()
        self._mend()
        loading, distance = self._loading(given), self._distances[-1]
        if start is not None:
            self._strategy.check(start)
        if loading.misses_contact(distance):
            start = None  # there is no pressure
        history, self._cut_short = History(self.listeners), True
        with self.options.inserted():
            state, outcome = self._strategy.run(loading, history, start)
            self._cut_short = False
            try:
                return self._solution(state, loading, outcome, history, started, products, before)
            finally:
                state.destroy()

    def path(self, stiffness=False, rows=(), **loadings):
        """Solve for many loads, one after the other.

        Parameters
        ----------
        stiffness : bool
            Solve for the exact stiffness of every step, too.
        rows : sequence of dict, optional
            Of steps done already, see `app.api.load_path.LoadPath`.
        **loadings : sequence of float
            Exactly one of load, approach, mean_pressure and mean_gap, as of `solve`.

        Returns
        -------
        LoadPath
            Iterate over it for the Solutions; its ``table`` has the numbers of all steps.

        Raises
        ------
        InputError
            If a number is not allowed.
        """
        self._refuse_if_closed()
        [(kind, numbers)] = call_collectively(self.comm, exactly_one, loadings).items()
        return LoadPath(self, kind, numbers, stiffness, rows)

    def check(self, **loading):
        """Refuse a loading that `solve` would refuse. Collective."""
        self.check_all([loading])

    @synchronized
    def check_all(self, loadings):
        """Refuse the first of some loadings, as keywords of `solve`, that it would refuse. Collective."""
        self._refuse_if_closed()
        check_equal_on_ranks(self.comm, loadings, "loading")
        for given in loadings:
            self._loading(given)

    @synchronized
    def update(self, problem):
        """Solve another problem from now on, of the same grid and material: a gap that is worn, or slides.

        Collective. What is set up stays, solutions stay what they are, and one may be a `start`. After an InputError
        (another grid or material, contact impossible in all cells) the problem is the old one.
        """
        self._refuse_if_closed()
        before, ours = self.problem, self.problem.fits(problem)
        check_equal_on_ranks(self.comm, ours, "grid or material")
        if not ours:
            raise InputError("problem: needed: a ContactProblem of the solver's grid and material")
        self.problem = problem
        try:
            self._measure_shapes()
        except BaseException:
            self.problem, self._cut_short = before, True
            raise

    @synchronized
    def stiffness(self, solution):
        """Contact stiffness dF/d(approach) of a solution, exactly, by one more linear solve on its contact set.

        Parameters
        ----------
        solution : Solution
            Of this problem, grid and communicator.

        Returns
        -------
        float
            [N/mm]; 0 without contact, infinite where a periodic patch is in contact everywhere, NaN if the linear
            solver does not converge.
        """
        self._refuse_if_closed()
        self._strategy.check(solution, "solution")
        with self.options.inserted():
            return contact_stiffness(self.hierarchy, self._distances[-1], solution.contact)

    def _refuse_if_closed(self):
        if not self._finalizer.alive:
            raise InputError("the solver is closed")

    def _loading(self, given):
        loading = make_loading(self.problem.grid, self._distances[-1], **given)
        self._strategy.check_loading(loading, self._largest)
        return loading

    def _solution(self, state, loading, outcome, history, started, products, before):
        proof = certify(state, self.settings.error_bound)  # which may take a product
        applied, seconds = self.hierarchy.operator_applications() - products, time.perf_counter() - started
        found = measures.measure_contact(state)
        proof = proof.under(loading.load, found.load)
        outcome = outcome.require_bound(proof.error_bound, self.settings.error_bound)
        found = loading.restore_prescribed(found)
        distance, depth, last = state.distance, state.depth, len(self.hierarchy.levels) - 1
        approach, extent = loading.solved_approach(state), measure_moments(state)
        notes = notes_on(state, self.problem, found, self._roughness)
        # Rank 0 has a part in every grid and window.
        counted = applied, history.entries, self.comm.traffic.since(before)
        applied, history.entries, traffic = self.comm.bcast(counted)
        return Solution(
            pressure=state.p,
            displacement=state.u,
            distance=synchronized(lambda: distance.h_at(depth)),
            contact=state.contact.copy(),
            converged=outcome.converged,
            message=outcome.reason,
            approach=approach,
            indentation=depth - distance.lowest,
            residual=outcome.residual,
            iterations=outcome.iterations,
            inner_iterations=sum(e["inner_iterations"] for e in history.entries if e["level"] == last),
            work_units=sum(entry["work_units"] for entry in history.entries),
            operator_applications=applied,
            discretisation_error=outcome.discretisation_error,
            **outcome.grid_errors.with_contact_edge(found)._asdict(),
            fallbacks=outcome.fallbacks,
            **found._asdict(),
            **extent._asdict(),
            rms_height=self._roughness.rms_height,
            rms_slope=self._roughness.rms_slope,
            rtol=self.settings.rtol,
            certificate=proof,
            history=history.columns(),
            problem=self.problem.describe()
            | (analytic_values(self.problem, approach, loading.load) if found.load > 0 else {})
            | theories(self.problem, found.mean_pressure, self._roughness.rms_slope),
            options=format_options(self.settings.texts),
            notes=(*self.settings.warnings, *notes),
            solve_seconds=seconds,
            setup_seconds=self.setup_seconds,
            traffic=traffic,
            grid=self.problem.grid,
            slabs=self.hierarchy.slabs,
            comm=self._outer_comm,
        )

    def close(self):
        """Free everything; solutions stay. Collective."""
        self._finalizer()

    def __reduce__(self):
        raise TypeError("a ContactSolver cannot be pickled; its problem can, and solutions")

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()
