"""Loadings as users prescribe them."""

from itertools import pairwise

import numpy as np
import pytest
from cases import APPROACH, hertz, punch, self_affine
from running import assert_solves_lcp, solve

from app import ContactSolver


@pytest.mark.parametrize("method", ["fast", "norm", "mg_v11", "fmg_v11"])
def test_zero_load_just_touches(method):
    found = solve(punch(32), None, method, load=0.0)
    assert found.converged
    assert found.load == 0
    assert np.nanmin(found.undeformed_distance) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("warm", [False, True], ids=["cold", "warm"])
@pytest.mark.parametrize(
    ("problem", "approach"),
    [(hertz(48), APPROACH), (punch(48), 0.25), (self_affine(48), 0.02)],
    ids=["hertz", "rough", "affine"],
)
def test_load_path_is_monotone(problem, approach, warm):
    """Approach, contact and displacement grow with the load, and unloading reverses loading."""
    highest = solve(problem, approach, "fast").load
    loads = highest * np.array([0.01, 0.05, 0.2, 0.6, 1.0])
    steps, start = [], None
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        for load in (*loads, *loads[-2::-1]):
            start = solver.solve(load=load, start=start if warm else None)
            assert_solves_lcp(start, 1e-9)
            assert start.load == pytest.approx(load, rel=1e-12)
            steps.append(start)
    up, down = steps[: len(loads)], steps[len(loads) - 1 :][::-1]
    for before, after in pairwise(up):
        assert after.approach > before.approach
        assert (after.contact >= before.contact).all()
        assert (after.displacement >= before.displacement - 1e-9 * after.displacement.max()).all()
    for there, back in zip(up, down, strict=True):  # elastic: the way back is the way there
        assert back.approach == pytest.approx(
            there.approach, abs=1e-8 * np.nanmax(abs(there.undeformed_distance))
        )
        np.testing.assert_array_equal(back.contact, there.contact)


def test_load_and_approach_of_hertz():
    exact = hertz(8).reference(APPROACH)
    found = solve(hertz(128), None, "fast", exact.load)
    assert found.approach == pytest.approx(APPROACH, rel=1e-4)
