"""Loadings as users prescribe them."""

import numpy as np
import pytest
from cases import periodic_rough, punch
from running import solve


@pytest.mark.parametrize("problem", [punch(64), periodic_rough(64)], ids=["free", "periodic"])
@pytest.mark.parametrize("method", ["fast", "norm", "mg_v11", "fmg_v11"])
def test_zero_load_just_touches_without_any_pressure(problem, method):
    method = None if problem.grid.periodic and method == "fast" else method
    solution = solve(problem, None, method, load=0.0)
    assert solution.converged
    assert solution.load == 0
    assert solution.approach == np.nanmin(solution.undeformed_distance + solution.approach)
    assert solution.certificate.error_bound == 0
    assert len(solution.history.get("level", [])) <= 1  # coarse grids leave no rounding errors
