"""The default methods prove what they return, with any numpy, scipy and numba: see `run/newest`."""

import numpy as np
import pytest
from cases import hertz, periodic_rough, punch

from app import ContactProblem, Grid, Material, solve


def bumps():
    """Many contact spots on a free patch, which are `scattered` to the preconditioner."""
    grid = Grid.from_domain(256, 256, (0.0, 1.0, 0.0, 1.0))
    wave = np.cos(2 * np.pi * grid.x() * 256 / 24)
    return ContactProblem(grid, Material.from_contact_modulus(1.0), 0.1 * (2 - wave[None] - wave[:, None]))


@pytest.mark.parametrize(
    ("problem", "loading"),
    [
        (hertz(64), {"approach": 0.1091}),
        (hertz(64), {"load": 82e3}),
        (punch(128), {"approach": 0.25}),
        (bumps(), {"approach": 0.5}),
        (periodic_rough(64), {"load": 100.0}),
        (periodic_rough(64), {"mean_gap": 0.005}),
    ],
    ids=["sphere", "sphere by load", "punch", "bumps", "periodic by load", "periodic by mean gap"],
)
def test_a_solution_is_proved(problem, loading):
    found = solve(problem, **loading)
    assert found.converged and found.error_bound < 0.01  # -lcp_error_bound
    (name,) = loading
    assert getattr(found, name) == pytest.approx(loading[name], rel=1e-9)
