"""Creep of viscoelastic bodies: a contact problem over time.

The displacement is ``u(t) = A (p(t) + sum J_i e_i(t))``, with the internal pressures ``e_i' = (p - e_i) / tau_i`` of
`app.halfspace.creep.CreepFunction`. If p changes linearly in a time step, the e_i change exactly. So the displacement
at the end of a step is A (c p + r), where r is due to the pressures before, and every step is a usual contact problem
with a proved solution (`app.api.shifted_problem`). The first time is that of a sudden load, at which the bodies have
their instantaneous moduli.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from app.api.analytic_values import THEORIES
from app.api.load_path import LoadPath
from app.api.shifted_problem import ShiftedProblem
from app.base.errors import InputError, format_exact
from app.parallel.reductions import minimum_over, sum_over

# Linear in the pressure.
_SUMS = "max_pressure", "mean_contact_pressure", "moment_x", "moment_y"
_DISPLACEMENT_ROUNDING = 1e-15  # displacement by a constant pressure, over that of one cell


class CreepStep(ShiftedProblem):
    """Time step of viscoelastic bodies: e = h + A (c p + r). Collective.

    Parameters
    ----------
    problem, hierarchy, pressure
        See `ShiftedProblem`; `pressure` is r [N/mm2].
    factor : float
        Factor c, at least 1.
    """

    def __init__(self, problem, hierarchy, pressure, factor):
        if not problem.grid.doubly_periodic:
            super().__init__(problem, hierarchy, pressure)
        else:  # without the mean of r, which does not displace the surface, there is less rounding
            mean = sum_over(hierarchy.comm, [pressure.sum()])[0] / problem.grid.n
            super().__init__(problem, hierarchy, pressure - mean)
            [lowest] = minimum_over(hierarchy.comm, [-abs(self.displacement).max(initial=0.0)])
            if -lowest <= _DISPLACEMENT_ROUNDING * hierarchy.target.diagonal * abs(mean):
                self.displacement[...] = 0.0  # flat bodies stay flat
        self.factor = factor

    def add_to(self, solution, values):
        """Return the Solution of p; see `ShiftedProblem.add_to`."""
        proof, c = solution.certificate, self.factor
        numbers = {name: getattr(solution, name) / c for name in _SUMS}
        theories = tuple(
            name for name in solution.problem if name.startswith("analytic_") or name in THEORIES
        )
        load, mean_pressure = self.totals(values, solution.load / c)
        return replace(
            super().add_to(solution, values),
            pressure=solution.pressure / c,
            load=load,
            mean_pressure=mean_pressure,
            indentation=solution.approach - self.touching,
            problem={name: value for name, value in solution.problem.items() if name not in theories},
            **numbers,
            certificate=replace(
                proof,
                duality_gap=proof.duality_gap / c,
                smallest_pressure=proof.smallest_pressure / c,
            ),
        )


class CreepPath(LoadPath):
    """Iterator over the solutions of viscoelastic bodies at increasing times. Collective.

    Solutions and table have the ``time`` [s]. Other arguments and attributes are those of `LoadPath`.

    Parameters
    ----------
    times : sequence of float
        Times [s], increasing. Between two times pressures change linearly.
    """

    times: list[float]
    can_resume = False

    def __init__(self, solver, times, kind, numbers, stiffness=False, progress=False):
        super().__init__(solver, kind, numbers, stiffness, (), progress)
        self.times, self.coordinates = times, {"time": times}
        self._creep = solver.problem.material.creep
        shape = solver.hierarchy.target.local_shape
        self._pressure = np.zeros(shape)  # p and the e_i of the last finished step
        self._internal = np.zeros((len(self._creep.strengths), *shape))

    def _solve_step(self, history, number):
        step, strengths, p, internal = len(self.rows), self._creep.strengths, self._pressure, self._internal
        if not step:
            self._pressure = (solution := self._solve_counted(number)).pressure
            return solution
        decay, before, after = self._creep.step(self.times[step] - self.times[step - 1])
        internal = decay[:, None, None] * internal + np.multiply.outer(before, p)
        past, factor = np.tensordot(strengths, internal, 1), 1 + float(strengths @ after)
        with self._solver.shifted(CreepStep(self._problem, self._solver.hierarchy, past, factor)):
            solution = self._solve_counted(number)
        self._pressure = solution.pressure
        self._internal = internal + np.multiply.outer(after, solution.pressure)
        return solution


def as_times(times):
    """Return increasing times as floats, checked."""
    try:
        values = [float(time) for time in times]
    except (TypeError, ValueError):
        raise InputError("times: must be a sequence of numbers [s]") from None
    if not values or not np.isfinite(values).all():
        raise InputError("times: must be a sequence of finite numbers [s], one at least")
    for before, after in pairwise(values):
        if not after > before:
            raise InputError(
                f"times: {format_exact(after)} s follows {format_exact(before)} s; must increase"
            )
    return values
