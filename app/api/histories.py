"""Many solutions, one after the other: the methods `path`, `creep` and `wear` of a solver."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from typing import Any, Self

import numpy as np

from app.api.arguments import check_parts
from app.api.creep import CreepPath, as_times
from app.api.load_path import LoadPath
from app.api.shifted_problem import check_kind
from app.api.wear import WearPath
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, is_number, plain_number
from app.base.petsc import synchronized
from app.base.types import ArrayLike, Length, Prescribed
from app.base.usage import usage
from app.contact.loading_input import USAGE, single_loading
from app.contact.tilting_input import single_path
from app.problems.arrays import check_compliance
from app.problems.problem import Problem


class Histories:
    """Methods of `ContactSolver` for many loads, and for bodies that change over time."""

    _step = _measured_step = None  # ShiftedProblem of the next solve, and that of the present distances
    _own = None, None  # a problem, and first touch and roughness of its own shape

    def path(
        self,
        stiffness: bool = False,
        rows: Iterable[Mapping[str, Any]] = (),
        progress: bool = False,
        flow: bool = False,
        **loadings: Iterable[Length] | None,
    ) -> LoadPath:
        """Solve for many loads, one after the other.

        Parameters
        ----------
        stiffness, flow : bool
            Solve for the exact stiffness and the conductance, and for the flow through the gap of every step, too.
        rows : sequence of dict, optional
            Rows of finished steps, which are not solved again; see `app.api.load_path.LoadPath`.
        progress : bool
            Show a progress bar (tqdm) on rank 0.
        **loadings : sequence of float
            Prescribed quantity, see `app.solve`. Give exactly one. `load_centre` and so on hold for all steps.

        Returns
        -------
        LoadPath
            An iteration over the path yields the Solutions; its ``table`` has the numbers of all steps solved so far.

        Raises
        ------
        InputError
            If a number is not allowed.
        """
        self._check_open()
        kind, numbers, tilting = call_collectively(self.comm, single_path, loadings)
        return LoadPath(self, kind, numbers, stiffness, rows, progress, flow, tilting)

    @synchronized
    def check(self, **loading: Prescribed) -> None:
        """Raise InputError for a loading that is not allowed."""
        self._check_open()
        check_equal_on_ranks(self.comm, loading, "loading")
        self._strategy.check_loading(self._make_loading(loading), self._largest)

    @usage(f"solver.creep(times=[0, 1, 10], {USAGE}")
    def creep(
        self,
        times: Iterable[float],
        *,
        stiffness: bool = False,
        progress: bool = False,
        **loadings: Length | Iterable[Length] | None,
    ) -> CreepPath:
        """Solve for viscoelastic bodies at several times.

        Parameters
        ----------
        times : sequence of float
            Times [s], increasing. At the first one the load is applied suddenly; between two times pressures change
            linearly, so the error of a step is of second order in its duration.
        stiffness, progress : bool
            See `ContactSolver.path`.
        **loadings : float or sequence of float
            Exactly one of the loadings, see `solve`: one number, or one for each time.

        Returns
        -------
        CreepPath
            An iteration over it yields the Solutions. Its ``table`` has a column ``time``.

        Raises
        ------
        InputError
            If a number is not allowed, or the material is not viscoelastic (`Material.viscoelastic`), or the problem
            has a hardness, a background pressure or a surface compliance.
        """
        if self.problem.material.creep is None:
            raise InputError(
                "creep: the material is elastic; make it by material.viscoelastic(times, moduli)"
            )
        times = call_collectively(self.comm, as_times, times)
        check_equal_on_ranks(self.comm, times, "creep: times")
        steps = len(times), "times"
        kind, numbers = self._begin_history("creep", loadings, *steps, "surface_compliance")
        check_kind(kind, "creep")
        return CreepPath(self, times, kind, numbers, stiffness, progress)

    @usage(f"solver.wear(coefficient=1e-9, distance=4000, steps=80, {USAGE}")
    def wear(
        self,
        coefficient: ArrayLike,
        distance: float,
        steps: int,
        *,
        stiffness: bool = False,
        progress: bool = False,
        **loadings: Length | Iterable[Length] | None,
    ) -> WearPath:
        """Solve for bodies that wear by Archard's law, in implicit steps.

        Parameters
        ----------
        coefficient : float or array_like, shape (ny, nx)
            Wear coefficient k, the worn volume over load and distance [mm2/N]; of each cell from 0.
        distance : float
            Sliding distance of all steps [mm].
        steps : int
            Number of steps.
        stiffness, progress : bool
            See `ContactSolver.path`.
        **loadings : float or sequence of float
            Exactly one of the loadings, see `solve`: one number, or one for each step.

        Returns
        -------
        WearPath
            An iteration over it yields the Solutions at the ends of the steps, with a field ``worn_depth`` [mm] and a
            number ``worn_volume`` [mm3], both since the start. Its ``table`` has ``sliding_distance``, too.

        Raises
        ------
        InputError
            If a number is not allowed, or the problem has a hardness or a background pressure.
        """
        for name, value in (("coefficient", coefficient), ("distance", distance)):
            if name == "coefficient" and np.ndim(value):
                coefficient = check_compliance(value, self.problem.grid, name)
            elif not (is_number(plain_number(value)) and 0 < float(value) < np.inf):
                raise InputError(f"{name} {value}: must be a positive number")
        coefficient = coefficient if np.ndim(coefficient) else float(coefficient)
        steps = plain_number(steps)
        if not (isinstance(steps, int) and not isinstance(steps, bool) and steps > 0):
            raise InputError(f"steps {steps}: must be a whole number from 1")
        kind, numbers = self._begin_history("wear", loadings, steps, "steps")
        compliance = coefficient * (float(distance) / steps)
        problem = copy(self.problem)
        object.__setattr__(problem, "surface_compliance", problem.surface_compliance + compliance)
        solver = type(self)(problem, *self._made_by)
        solver.quiet = self.quiet
        solver.with_stiffness = self.with_stiffness  # of the bodies, without k s
        distances = (float(distance) * np.arange(1, steps + 1) / steps).tolist()
        return WearPath(solver, self.problem, compliance, distances, kind, numbers, stiffness, progress)

    def _begin_history(self, what, loadings, count, steps, *refused):
        """Return the prescribed quantity, and a number for each of `count` steps, checked."""
        self._check_open()
        check_parts(what, self.problem, "hardness", "background_pressure", *refused)
        kind, numbers = call_collectively(self.comm, single_loading, loadings, f"{what}: ")
        numbers = [numbers] * count if np.ndim(numbers) == 0 else numbers
        if len(numbers) != count:
            raise InputError(f"{what}: {len(numbers)} values of {kind} for {count} {steps}")
        return kind, numbers

    @contextmanager
    def replaced(self, problem: Problem) -> Iterator[Self]:
        """Replace the problem by `update` during a ``with`` block."""
        before = self.problem
        if problem is before:
            yield self
            return
        self.update(problem)
        try:
            yield self
        except BaseException:
            self.problem, self._was_interrupted = before, True
            raise
        self.update(before)

    @contextmanager
    def shifted(self, step: Any) -> Iterator[Self]:
        """Solve a `ShiftedProblem` instead of the problem during a ``with`` block; None: the problem."""
        self._step, before = step, self._step
        try:
            yield self
        finally:
            self._step = before
