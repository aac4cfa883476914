"""Strategies (-lcp_type), which run the iteration of a method.

`ActiveSet` runs the paper's iteration, in `app.contact`. `Fast` runs `app.methods.free`, `Primal` runs
`app.methods.periodic`, and `Film` runs `app.methods.film`.
"""

from functools import partial

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError, call_collectively
from app.base.petsc import error_message, to_input_error
from app.contact.active_set import active_set_or_search
from app.contact.full_contact import FullContact
from app.contact.full_multigrid import full_multigrid
from app.contact.full_plasticity import CONTACT_PLASTIC, FullPlasticity, move_to_lower_end
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.contact.stopping import StoppingTest
from app.methods import multilevel_operators
from app.methods.film.iteration import MAX_LOAD_RATIO, interpolate_pressure, solve_film
from app.methods.free import circulant, lift
from app.methods.free.dilute import DiluteContact
from app.methods.free.nested import nested_iteration, solve_level
from app.methods.free.solver import TrackingSolver
from app.methods.free.window_cache import WindowCache
from app.methods.periodic import solver as primal_solver
from app.methods.periodic.nested import primal_iteration
from app.methods.periodic.solver import PrimalSolver
from app.methods.snesvi import SnesVI
from app.methods.stopping import InexactStop
from app.multigrid import direct
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.multigrid.solver_cache import SolverCache
from app.options.viewers import estimate_files

_CG = "cg", "fcg", "pipecg", "groppcg", "minres", "python"  # python: CG of the default methods
INDEFINITE = (
    "perhaps because the preconditioner (-pc_type) is not symmetric positive definite, which CG needs"
)


class Strategy:
    """Base class of strategies for a method's iteration. Collective.

    Parameters
    ----------
    settings : app.options.method.Settings
    hierarchy : Hierarchy

    Attributes
    ----------
    solver : LinearSolver, a reference solver, or None
        Solver on the target grid. None if the iteration works in a window of this grid that is not known yet.
    """

    target_only = False  # True: needs no coarser grid
    finds_approach = True  # False: solves by approach only, not by load
    can_tilt = False

    def __init__(self, settings, hierarchy: Hierarchy):
        self._settings, self._hierarchy, self._distances = settings, hierarchy, None
        self.solver = self._make_solver()
        self._cache = self._make_cache()

    def _make_solver(self):
        return LinearSolver(self._hierarchy)

    def _make_cache(self):
        return SolverCache(LinearSolver, self._hierarchy, self.solver)

    def prepare(self):
        """Create the operators that depend only on the grids, for all solves."""
        if self._settings.prolongation == "lift":
            for operator in self._hierarchy.levels:
                if not self._hierarchy.may_be_windowed(operator):
                    circulant.circulant_inverse(operator)

    def use_distances(self, distances, coarse_minimum):
        """Set the undeformed distances to solve for.

        Parameters
        ----------
        distances : list of UndeformedDistance
            Undeformed distances on all levels.
        coarse_minimum : ndarray or None
            Least distance in each cell of the finest unwindowed level, see `Hierarchy.coarse_minimum`.
        """
        self._distances, self._coarse_minimum = distances, coarse_minimum

    def run(self, loading, history, start=None):
        """Solve for a loading, from scratch or from a checked Solution `start`.

        Returns
        -------
        ContactState, Outcome
            State on the target grid, and outcome of the iteration there.

        Raises
        ------
        InputError
            If PETSc finds the chosen solvers incompatible.
        """
        try:
            state, outcome = self._run(loading, history, start)
        except PETSc.Error as error:
            files = estimate_files(self._settings.texts, 0)
            raise to_input_error(error, files) from error.__cause__
        if move_to_lower_end(state, None if loading.tilts else loading.load):
            outcome = outcome._replace(converged=True, reason=CONTACT_PLASTIC, residual=0.0)
        if (
            not outcome.converged
            and "definite" not in outcome.reason
            and _may_be_indefinite(self._settings.texts)
        ):
            outcome = outcome._replace(reason=f"{outcome.reason}; {INDEFINITE}")
        return state, outcome

    def _run(self, loading, history, start):
        hierarchy, full = self._hierarchy, None
        for level in hierarchy.levels:
            level.reset_sweeps()
        if self._distances[-1].bounds.largest_load < np.inf:
            state = self._new_state()
            if outcome := FullPlasticity(len(hierarchy.levels) - 1).solve(state, loading, history):
                return state, outcome
            state.destroy()
        if hierarchy.target.is_singular:
            full = FullContact(hierarchy, self._distances)
            state = self._new_state()
            if outcome := full.solve(state, loading, self._stop(), history):
                return state, outcome
            state.destroy()
            del state
        state, outcome = self._solve(loading, history, start)
        if full and full.postponed and not (outcome.converged and state.elastic_cells() < state.grid.n):
            return self._in_full_contact(full, loading, history, state, outcome)
        return state, outcome

    def _in_full_contact(self, full, loading, history, state, outcome):
        """Return state and outcome of full contact if it solves the problem.

        Otherwise return the given `state` and `outcome`.
        """
        contact, full_state = state.contact.copy(), self._new_state()
        if full_outcome := full.solve(full_state, loading, self._stop(), history):
            state.destroy()
            return full_state, full_outcome.after(outcome)
        full_state.destroy()
        state.contact[...] = contact
        return state, outcome

    def _solve(self, loading, history, start):
        raise NotImplementedError

    def _stop(self):
        return StoppingTest(self._settings.rtol, self._settings.max_it)

    def _new_state(self):
        return contact_state(self._hierarchy.target, self._distances[-1])

    def destroy(self):
        """Free the solver, and the cached solvers of the levels."""
        self._cache.destroy()
        if self.solver is not None:
            self.solver.destroy()

    def check_loading(self, loading, largest):
        """Raise InputError for a loading that the method cannot solve for.

        `largest` is the largest influence coefficient [mm3/N]. In single precision the pressures, estimated from
        `largest`, must be in range.
        """
        if not (loading.approach_is_known or self.finds_approach):
            raise InputError(f"-lcp_type {self._settings.type}: needs a prescribed approach, not a load")
        if loading.is_tilted and not self.can_tilt:
            raise InputError(
                f"-lcp_type {self._settings.type}: bodies cannot tilt; -lcp_type fast can tilt them"
            )
        if self._settings.single:
            pressure = loading.largest_pressure(self._distances[-1], self._hierarchy.target.grid, largest)
            check_single("pressures", pressure, "N/mm2")

    def _started_from(self, start, loading):
        """Return the state from which to start, made from a Solution `start`."""
        target = self._hierarchy.target
        uniform = target.kernel.uniform_compliance(target.grid) * start.mean_pressure
        state = contact_state(target, self._distances[-1], u=start.displacement - uniform)
        state.values[...] = start.pressure
        state.project()  # the solution may be of a problem with other holes
        if state.sum([np.count_nonzero(state.p != start.pressure)])[0]:
            state.displacement_status = Displacement.STALE
        state.contact[...] = start.contact & state.admissible
        if start.plastic is not None:
            state.contact &= ~start.plastic
        loading.resume(state, start.load)
        return state


class ActiveSet(Strategy):
    """Strategy ``active_set``: the paper's iteration, with any linear solver."""

    def _solve(self, loading, history, start):
        if start is not None:
            state = self._started_from(start, loading)
            solve = partial(active_set_or_search, state, self.solver, stop=self._stop(), history=history)
            return state, loading.next_solve(state, solve)
        settings = self._settings
        return full_multigrid(
            self._hierarchy, self._distances, loading, self._stop(), history, settings.nested, settings.beta,
            lift.lift if settings.prolongation == "lift" else None, self._cache,
        )  # fmt: skip


class Film(ActiveSet):
    """Strategy ``film``, default for thin, nearly incompressible layers on a rigid base."""

    def _solve(self, loading, history, start):
        settings, hierarchy = self._settings, self._hierarchy
        iterate = partial(solve_film, hierarchy)
        capped = start is not None and start.plastic is not None
        if capped and loading.load is not None and not hierarchy.target.grid.doubly_periodic:
            # Pressures at the hardness cannot be scaled to a very different load.
            low, high = sorted((start.load, loading.load))
            start = start if high <= MAX_LOAD_RATIO * low else None
        if start is None:
            return full_multigrid(
                hierarchy, self._distances, loading, self._stop(), history, settings.nested, settings.beta,
                interpolate_pressure, self._cache, iterate,
            )  # fmt: skip
        state, last = self._started_from(start, loading), len(hierarchy.levels) - 1
        return state, iterate(last, state, self.solver, loading, self._stop(), history)

    def _stop(self):
        return InexactStop.of(self._settings)


class Inexact(Strategy):
    """Base class of the default methods, which solve linear systems inexactly, and dilute contact on lists."""

    def __init__(self, settings, hierarchy):
        super().__init__(settings, hierarchy)
        self._lists = DiluteContact(hierarchy) if hierarchy.lists else None

    def use_distances(self, distances, coarse_minimum):
        """Set the undeformed distances; see `Strategy.use_distances`."""
        super().use_distances(distances, coarse_minimum)
        if self._lists:
            self._lists.use_distances(distances)

    def _run(self, loading, history, start):
        state, outcome = super()._run(loading, history, start)
        return state, outcome._replace(to_rounding=True)

    def prepare(self):
        """Create the operators of the grids, and the solvers of small grids."""
        super().prepare()
        if self._settings.nested:
            self._cache.prepare(self._first_solver_level())

    def _first_solver_level(self):
        return 0

    def _solve(self, loading, history, start):
        hierarchy, stop, lists = self._hierarchy, InexactStop.of(self._settings), self._lists
        lists = lists if lists and lists.suit(len(hierarchy.levels) - 1, loading) else None
        if lists and start is not None and (loaded := lists.loaded_cells(start)):
            cells, pressures = loaded
            if cells.size and (solved := lists.resume(cells, pressures, start.load, loading, stop, history)):
                return solved
            start = None
        return self._solve_grids(loading, history, stop, start, lists)

    def _solve_grids(self, loading, history, stop, start, lists):
        """Solve on all grids, the fine ones on `lists` unless None, or from a `start` on all cells of the target."""
        raise NotImplementedError


class Fast(Inexact):
    """Strategy ``fast``, default on free patches: TrackingCG in windows."""

    can_tilt = True

    def __init__(self, settings, hierarchy):
        super().__init__(settings, hierarchy)
        operator = hierarchy.levels[hierarchy.finest_unwindowed]
        if operator.active:
            self._cache.solver(hierarchy.finest_unwindowed, operator)  # raises for wrong options

    def _make_solver(self):
        hierarchy = self._hierarchy
        return None if hierarchy.may_be_windowed(hierarchy.target) else TrackingSolver(hierarchy)

    def _make_cache(self):
        return WindowCache(self._hierarchy, self.solver)

    def _first_solver_level(self):
        return int(direct.starts_directly(self._hierarchy, 0))

    def prepare(self):
        """Create the grids' operators, and the multilevel products."""
        super().prepare()
        if not self._hierarchy.target.grid.doubly_periodic:
            multilevel_operators.prepare(self._hierarchy.target.grid, self._hierarchy.kernel)

    def _solve_grids(self, loading, history, stop, start, lists):
        hierarchy, cache = self._hierarchy, self._cache
        if start is not None:
            hierarchy.prepare_target()
            state, last = self._started_from(start, loading), len(hierarchy.levels) - 1
            if not loading.tilts or loading.slope is not None:
                return state, solve_level(hierarchy, last, state, loading, stop, history, False, cache)
            state.destroy()
        try:
            return nested_iteration(
                hierarchy, self._distances, loading, stop, history, self._coarse_minimum, cache, lists
            )
        except BaseException:
            self._cache.reset_windows()
            raise


class Primal(Inexact):
    """Strategy ``primal``, the default on periodic patches: CarryingCG."""

    def __init__(self, settings, hierarchy):
        super().__init__(settings, hierarchy)
        if self.solver is None:
            number = self._unlisted[-1]
            if hierarchy.levels[number].active:
                self._cache.solver(number, hierarchy.levels[number])  # raises for wrong options

    def _make_solver(self):
        hierarchy = self._hierarchy
        if not hierarchy.lists:
            return self._make_target_solver()
        # Perhaps all grids but these are solved on lists.
        levels = enumerate(hierarchy.levels)
        self._unlisted = [
            n for n, level in levels if not (n and DiluteContact.suits(level.grid, level.kernel))
        ]
        primal_solver.prepare(hierarchy, self._settings.defect_correction > 0, self._unlisted)
        return None

    def _make_target_solver(self):
        primal_solver.prepare(self._hierarchy, self._settings.defect_correction > 0)
        return PrimalSolver(self._hierarchy)

    def _make_cache(self):
        return SolverCache(PrimalSolver, self._hierarchy, self.solver)

    def _use_all_cells(self):
        """Prepare for solves of the fine grids on all cells, when these are first needed."""
        if self.solver is None:
            self._hierarchy.prepare_target()
            self.solver = self._cache.target = self._make_target_solver()

    def _solve_grids(self, loading, history, stop, start, lists):
        if start is not None or not lists:
            lists = None
            self._use_all_cells()
        fields = self._hierarchy, self._distances, loading, stop, history, self._cache
        return primal_iteration(*fields, start, lists, self._use_all_cells)


class Reference(Strategy):
    """Strategy ``snesvi``: PETSc's solver of variational inequalities."""

    target_only, finds_approach = True, False

    def _make_solver(self):
        return SnesVI(self._hierarchy, self._stop())

    def _solve(self, loading, history, start):
        state = self._new_state()
        state.depth = loading.depth_on(state.distance)
        try:
            return state, self.solver.solve(state, history, start)
        except PETSc.Error:
            state.destroy()
            raise


STRATEGIES = {"active_set": ActiveSet, "film": Film, "fast": Fast, "primal": Primal, "snesvi": Reference}


def _may_be_indefinite(texts):
    """Return whether options choose CG with a preconditioner that need not be symmetric positive definite."""
    kind, symmetric = (
        texts.get("pc_type", "none"),
        {"pc_sor_symmetric", "pc_sor_local_symmetric"} & texts.keys(),
    )
    foreign = not texts.get("pc_python_type", "").startswith("app.") if kind == "python" else not symmetric
    return texts.get("ksp_type") in _CG and kind not in ("none", "jacobi", "mg") and foreign


def allows_lists(settings, problem):
    """Return whether grids may be solved on lists of cells (`app.methods.free.dilute`)."""
    free = settings.type == "fast" and settings.window > 0
    free &= settings.texts.get("pc_python_type", "").endswith(".Circulant")
    usual = settings.nested and (free or settings.type == "primal")
    return usual and problem.compliance is None and DiluteContact.suits(problem.grid, problem.kernel)


def make_strategy(hierarchy, settings):
    """Make the strategy that the settings choose. Collective; InputError if PETSc refuses the options."""

    def make():
        try:
            return STRATEGIES[settings.type](settings, hierarchy)
        except PETSc.Error as error:
            raise ValueError(error_message(error)) from None
        except (ImportError, AttributeError) as error:
            raise ValueError(str(error)) from None

    try:
        return call_collectively(hierarchy.comm, make)
    except InputError as error:
        message = f"solver options: {error}"
    # Outside of the handler, where the error no longer refers to parts of the refused solver.
    hierarchy.collect_garbage()
    raise InputError(message)


def check_single(what, value, unit):
    """Raise InputError for a `value` beyond the range of single precision."""
    if value and not 1e-25 < value < 1e25:
        raise InputError(
            f"-lcp_precision single: {what} of {value:.0e} {unit} are beyond it; choose -lcp_precision double, "
            "or units nearer to the bodies'"
        )
