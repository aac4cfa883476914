"""Wear by Archard's law, step by step.

On a sliding distance s a cell loses the height k s p, with the wear coefficient k. In an implicit step the pressure is
that at the end of the step: e = h + w + A p + k s p, with the worn depth w before. So a step is the contact problem of
bodies with a compliant surface (`app.halfspace.compliant_kernel`), and has a proved solution. An explicit step, which
takes the pressure before, oscillates from k s E* / dx = 0.2 on; an implicit step does not at any distance. In full
contact a wave of wave number q shrinks by the factor 1 / (1 + k s E* q / 2) in each step.
"""

from dataclasses import replace

import numpy as np

from app.api.load_path import LoadPath
from app.api.shifted_problem import ShiftedProblem
from app.parallel.reductions import sum_over


class WearStep(ShiftedProblem):
    """Step of a sliding distance. Collective.

    Parameters
    ----------
    problem, hierarchy
        See `ShiftedProblem`.
    bodies : Problem
        Problem without k s.
    worn : ndarray, shape (local rows, nx)
        Worn depth before the step [mm].
    compliance : float or ndarray, shape (local rows, nx)
        k s [mm / (N/mm2)].
    """

    def __init__(self, problem, hierarchy, bodies, worn, compliance):
        self.grid, self.comm, self.hardness = problem.grid, hierarchy.comm, None
        self.bodies, self.displacement, self.compliance = bodies, worn, compliance
        self._fields = bodies.fields(hierarchy.slabs.rows)

    def add_to(self, solution, values):
        """Return the Solution with the worn shape; see `ShiftedProblem.add_to`."""
        now, distance = self.compliance * solution.pressure, solution.distance
        worn = self.displacement + now
        facts = {name: value for name, value in solution.problem.items() if name != "surface_compliance"}
        volume = sum_over(self.comm, [worn.sum()])[0] * self.grid.cell_area
        return replace(
            solution,
            deformation=solution.deformation_plus(-now),
            distance=lambda: distance() + now,
            indentation=solution.approach - self.touching,
            extra=self._fields | {"worn_depth": worn},
            problem=facts | self.bodies.describe() | {"worn_volume": float(volume)},
        )


class WearPath(LoadPath):
    """Iterator over the solutions of bodies that wear. Collective.

    Solutions and table have ``sliding_distance`` [mm] and ``worn_volume`` [mm3], both since the start. Other arguments
    and attributes are those of `LoadPath`.

    Parameters
    ----------
    solver : ContactSolver
        Solver of the problem with the surface compliance k s added.
    bodies : Problem
        Problem without k s.
    compliance : float or ndarray, shape (ny, nx)
        k s of one step [mm / (N/mm2)].
    distances : sequence of float
        Sliding distances at the ends of the steps [mm].
    """

    can_resume = False

    def __init__(self, solver, bodies, compliance, distances, kind, numbers, stiffness=False, progress=False):
        self.coordinates, self._bodies = {"sliding_distance": distances}, bodies
        self._compliance = compliance[solver.hierarchy.slabs.rows] if np.ndim(compliance) else compliance
        self._worn = np.zeros(solver.hierarchy.target.local_shape)
        super().__init__(solver, kind, numbers, stiffness, (), progress)

    def _solve_step(self, history, number):
        step = WearStep(self._problem, self._solver.hierarchy, self._bodies, self._worn, self._compliance)
        with self._solver.shifted(step):
            solution = self._solve_counted(number)
        self._worn = solution.extra["worn_depth"]
        return solution
