"""Verification product of a window."""

import gc
import weakref

from cases import bowl

from app import ContactSolver


def test_field_of_all_cells_is_freed_after_a_solve():
    with ContactSolver(bowl(160)) as solver:
        field = weakref.ref(solver.solve(approach=0.1).displacement)
        gc.collect()
        assert field() is None
