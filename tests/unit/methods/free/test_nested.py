"""Nested iteration of the default method."""

from cases import APPROACH, hertz

from app import ContactSolver


def test_a_start_leaves_out_coarser_grids():
    with ContactSolver(hertz(64)) as solver:
        first = solver.solve(approach=APPROACH)
        again = solver.solve(approach=APPROACH, start=first)
    assert len(set(first.history["level"])) > 1
    assert len(set(again.history["level"])) == 1
