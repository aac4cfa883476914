"""The undeformed distance: shape, approach and depth, and its statistics."""

import numpy as np
import pytest
from operators import random_field

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.distance import UndeformedDistance
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator


@pytest.mark.parametrize("approach", [0.0, -0.7, 3.0])
def test_undeformed_distance_is_shape_minus_approach(state, approach):
    state.approach = approach
    inside = state.admissible
    h = state.distance.h_at(state.depth)
    np.testing.assert_allclose(h[inside], state.shape[inside] - approach, atol=1e-14)
    assert state.h_norm == pytest.approx(np.linalg.norm(state.shape[inside] - approach), rel=1e-13)
    assert state.approach == pytest.approx(approach, abs=1e-15)
    assert state.first_touch() == pytest.approx(0.0, abs=1e-14)  # beyond the reference, the least distance
    state.depth = 0.25
    assert state.approach == pytest.approx(np.nanmin(state.shape) + 0.25, abs=1e-15)


def test_distances_with_a_large_constant_keep_their_digits():
    operator = InfluenceOperator(Grid(2, 1, 1.0, 1.0), UNIT)
    distance = UndeformedDistance(operator, np.array([[0.0, 1e-12]]), reference=1e6)
    np.testing.assert_allclose(distance.h_at(1e-11), [[-1e-11, -9e-12]], rtol=1e-12)
    distance.destroy()


def test_moves_are_exact(state):
    """The distance at a depth is independent of earlier moves."""
    before = state.distance.h_at(state.depth)
    for depth in (1e13, 3e-7, -1e9, 0.0):
        state.depth = depth
        np.testing.assert_array_equal(state.gap(), state.u - (depth + state.distance.b))
    np.testing.assert_array_equal(state.distance.h_at(state.depth), before)


def test_first_touch_is_independent_of_earlier_solves():
    """Moves that cost digits would change the gap of the cells that just touch."""
    grid = Grid.from_domain(48, 48, (-1, 1, -1, 1))
    ball = ContactProblem(grid, Material.from_contact_modulus(1e5), lambda x, y: (x**2 + y**2) / 40)
    with ContactSolver(ball) as solver:
        first, _, again = (solver.solve(load=load) for load in (0, 100, 0))
    assert first.gap.min() == 0
    np.testing.assert_array_equal(first.gap, again.gap)


@pytest.mark.parametrize(("nx", "ny"), [(45, 31), (50, 51), (33, 64)])
def test_mean_distance_of_samples_is_equal_on_all_grids(nx, ny):
    """Otherwise a coarse grid would reach full contact before the target."""
    grid = Grid.from_domain(nx, ny, (0, 1, 0, 1), "spectral")
    gap = random_field(grid, 1)
    with ContactSolver(
        ContactProblem(grid, Material.from_contact_modulus(1.0), gap, periodic=True)
    ) as solver:
        means = [distance.statistics.mean + distance.reference for distance in solver._distances]
    np.testing.assert_allclose(means, gap.mean(), rtol=0, atol=1e-14)
