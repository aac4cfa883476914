"""Problems solved in this process, through the API."""

import warnings

import numpy as np

from app.api.solver import ContactSolver
from app.base.errors import NoteWarning


def solve(problem, approach, method="norm", load=None, comm=None, start=None, **options):
    """Solve a problem by a method of petsc_options and more options; that it may not converge is for the test to see.

    Collective over `comm`, by default all ranks. A given `load` takes the place of the approach.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "not converged", RuntimeWarning)
        warnings.simplefilter("ignore", NoteWarning)
        with ContactSolver(problem, method, options, comm) as solver:
            return solver.solve(approach=None if load is not None else approach, load=load, start=start)


def assert_solves_lcp(solution, tolerance=1e-6):
    """Check e >= 0, p >= 0, p e = 0, relative to the size of h; without asking other ranks."""
    p, e, h, contact = solution.pressure, solution.gap, solution.undeformed_distance, solution.contact
    admissible = ~np.isnan(h)
    assert solution.converged, solution.message
    assert (p >= 0).all()
    assert (p[~contact] == 0).all()
    assert not contact[~admissible].any()
    assert (e[admissible & ~contact] > 0).all()
    assert np.linalg.norm(e[contact]) <= tolerance * np.linalg.norm(h[admissible])


def assert_proved_equal(one, other):
    """Check that two pressures of one problem differ by no more than is proved; without asking other ranks.

    Each is wrong by at most `error_bound` of its energy norm. Default methods compute in single precision, so nothing
    more is promised from one processor to the next.
    """
    moved, displaced = one.pressure - other.pressure, one.displacement - other.displacement
    proved = [
        found.error_bound * np.sqrt(np.vdot(found.pressure, found.displacement)) for found in (one, other)
    ]
    assert np.sqrt(max(0.0, np.vdot(moved, displaced))) <= sum(proved)
