"""Cache of window operators and solvers."""

import numpy as np
from cases import bowl
from running import assert_proved_equal

from app import ContactSolver, Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator


def test_operators_are_cached_by_size_not_by_place(created):
    with ContactSolver(bowl(160)) as solver:
        for approach in (0.05, 0.3, 0.05):
            again = solver.solve(approach=approach)
            with ContactSolver(bowl(160)) as fresh:
                alone = fresh.solve(approach=approach)
            assert_proved_equal(again, alone)


def test_small_windows_share_one_size(created):
    with ContactSolver(bowl(256)) as solver:
        solver.solve(approach=1e-3)
        created.clear()
        for approach in (2e-3, 4e-3, 8e-3):
            solver.solve(approach=approach)
        assert not created


def test_exact_products_of_windows_stay_counted():
    operator = InfluenceOperator(Grid(40, 40, 1.0, 1.0), UNIT, dtype=np.float32)
    p = np.ones(operator.local_shape)
    operator.exact_displacement(p, p.copy())
    operator.displacement(p, p.copy())
    operator.free_exact_product()
    assert operator.equivalent_products == 2
