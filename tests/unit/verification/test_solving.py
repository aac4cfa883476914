"""Solutions and random problems for the checks."""

import numpy as np
import pytest

from app.options.method import list_methods
from app.verification.solving import difference, methods, random_problem, solved


@pytest.mark.parametrize("periodic", ["", "spectral", "y"])
def test_random_problems_are_reproducible_and_touch_at_zero(periodic):
    one, same = (random_problem(np.random.default_rng(5), 9, 7, periodic) for _ in range(2))
    np.testing.assert_array_equal(one.gap, same.gap)
    assert one.grid.shape == (7, 9) and one.grid.periodic == periodic
    assert np.nanmin(random_problem(np.random.default_rng(5), 9, 7, holes=False).gap) == 0


def test_each_kind_of_patch_has_all_methods_but_the_default_of_the_other():
    assert (
        set(list_methods()) - set(methods(""))
        == set(list_methods()) - set(methods("y"))
        == {"film", "primal"}
    )
    assert set(list_methods()) - set(methods("spectral")) == {"fast", "film"}


def test_a_solve_that_does_not_converge_warns_of_nothing(recwarn):
    problem = random_problem(np.random.default_rng(1), 24, 16)
    assert not solved(problem, "norm", options={"lcp_max_it": 1}, approach=0.02).converged
    assert not [warning for warning in recwarn if "not converged" in str(warning.message)]


def test_differences_are_relative_to_the_largest_value():
    assert difference(np.array([1.0, 4.5]), np.array([1.0, 5.0])) == pytest.approx(0.1)
    assert difference(np.array([0.5]), np.array([0.0])) == 0.5
