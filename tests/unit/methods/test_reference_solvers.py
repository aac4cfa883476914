"""TAO and SNESVI."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactSolver


@pytest.mark.parametrize("kind", ["tao", "snesvi"])
def test_history_of_a_reference_solver_has_every_iteration(kind):
    found = solve(hertz(12), APPROACH, None, lcp_type=kind)
    history = found.history
    assert list(history["iteration"]) == list(range(1, found.iterations + 1))
    assert sum(history["inner_iterations"]) == found.inner_iterations
    assert history["residual"][-1] == pytest.approx(found.residual, rel=1e-12)
    assert history["contact_cells"][-1] == np.count_nonzero(found.contact)


@pytest.mark.parametrize("kind", ["tao", "snesvi"])
def test_second_solve_of_a_reference_solver_counts_its_own_work(kind):
    with ContactSolver(hertz(12), options={"lcp_type": kind}) as solver:
        first, second = (solver.solve(approach=APPROACH) for _ in range(2))
    assert second.work_units == first.work_units > 0
    assert second.inner_iterations == first.inner_iterations > 0


def test_tao_starts_from_a_solution():
    with ContactSolver(hertz(16), options={"lcp_type": "tao"}) as solver:
        first = solver.solve(approach=APPROACH)
        again = solver.solve(approach=APPROACH, start=first)
    assert again.operator_applications < first.operator_applications / 2
    assert again.load == pytest.approx(first.load, rel=1e-5)
