"""Solve and record every active set iteration, for Tables 1 and 4 and Figures 8 and 11."""

import warnings
from functools import partial

import numpy as np

from app.contact.history import Listener
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.contact_problem import ContactProblem
from app.problems.random_surfaces import WavySurface
from app.problems.shapes import FlatPunch, Paraboloid

HERTZ_DOMAIN = (-10.0, 10.0, -6.0, 6.0)  # mm, Sec. 5.1
PUNCH_DOMAIN = (-6.0, 6.0, -5.0, 5.0)  # mm, Sec. 5.2


def make_surface(decay=0.8):
    """Return the random surface of Sec. 5.2, with another decay if given."""
    x0, x1, y0, y1 = PUNCH_DOMAIN
    return WavySurface((12, 10), decay, 0.1, 7, extent=(x1 - x0, y1 - y0), origin=(x0, y0))


def _make_problem(name, n):
    if name == "hertz":
        grid = Grid.from_domain(n, n, HERTZ_DOMAIN)
        return ContactProblem(grid, Material.combined(82000.0, 0.28), Paraboloid(300.0, 163.0))
    grid, steel = Grid.from_domain(n, n, PUNCH_DOMAIN), Material.combined(80000.0, 0.28)
    return ContactProblem(grid, steel, FlatPunch(8.97), surfaces=[make_surface()])


class Recorder(Listener):
    """Recorder of iterations on the target grid, and of linear solves.

    `pressure` [N/mm2] and `contact` are the states before the first iteration and after each; `linear_residuals` [mm]
    are the norms of the defect in the KSP of the last system.
    """

    def __init__(self):
        self.pressure, self.contact, self.linear_residuals = [], [], []

    def start(self, state, level):
        """Delete the iterations of a coarser grid; store the initial state."""
        self.pressure, self.contact = [], []
        self.iteration(None, state)

    def iteration(self, entry, state):
        """Store pressure and contact set after an iteration."""
        self.pressure.append(state.p.copy())
        self.contact.append(state.contact.astype(int))

    def monitor(self, ksp, iteration, norm):
        """Store the norm of the defect in an iteration of a KSP.

        The KSP calls this function as a monitor. Norms of earlier linear solves are deleted.
        """
        if iteration == 0:
            self.linear_residuals = []
        self.linear_residuals.append(norm)


def traced(problem, method, n, collect, approach=0.1091, **options):
    """Return a function that solves a problem on n x n cells, and returns its outcome.

    `problem` is "hertz" or "punch", and `method` is the name of a method file, or None. Options that are None are left
    out. ``collect(recorder, solution, exact)`` returns results from a `Recorder`; `exact` is the analytic solution, or
    None if unknown.
    """
    options = {option: value for option, value in options.items() if value is not None}
    return partial(_solve, problem, method, n, collect, float(approach), options)


def _solve(name, method, n, collect, approach, options):
    from app.api.solver import ContactSolver  # importing PETSc starts it

    problem, recorder = _make_problem(name, n), Recorder()
    with (
        warnings.catch_warnings(action="ignore"),
        ContactSolver(problem, method, options, listeners=[recorder]) as solver,
    ):
        if solver.ksp is not None:
            # PETSc's own history stays empty if the PC iterates, as PCMG does.
            solver.ksp.setMonitor(recorder.monitor)
        solution = solver.solve(approach=approach)
    result = collect(recorder, solution, problem.reference(approach))
    return {"exit_status": 0 if solution.converged else 3, **result}


def collect_cycles(recorder, solution, exact):
    """Return the defect norms of the last linear system [mm]."""
    return {"linear_residuals": recorder.linear_residuals}


def collect_errors(recorder, solution, exact):
    """Return the pressure errors for Table 4 [N/mm2].

    The errors are root mean squares over the last contact set, before iteration 1 and after each iteration.
    """
    inside = recorder.contact[-1] == 1
    errors = (np.stack(recorder.pressure) - exact.pressure(solution.x, solution.y[:, None]))[:, inside]
    return {"errors": np.sqrt(np.mean(errors**2, axis=1)).tolist()}


def collect_contact(recorder, solution, exact):
    """Return contact sets, admissible cells and cell centres.

    The contact sets are the first and the last one.
    """
    admissible = (~np.isnan(solution.undeformed_distance)).astype(int)
    fields = {"first": recorder.contact[0], "last": recorder.contact[-1], "admissible": admissible}
    return fields | {"x": solution.x, "y": solution.y}
