"""Nested iteration of the primal form."""

import numpy as np
import periodic

from app import ContactSolver


def test_a_start_leaves_out_coarser_grids():
    problem = periodic.rough(64, 64, 8)
    approach = 0.3 * np.nanmean(problem.gap)
    with ContactSolver(problem) as solver:
        first = solver.solve(approach=approach)
        again = solver.solve(approach=approach, start=first)
    assert len(set(first.history["level"])) > 1
    assert len(set(again.history["level"])) == 1
