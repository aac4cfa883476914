"""Grids of cells and their coarsening."""

import numpy as np
import pytest

from app import Grid, InputError


@pytest.mark.parametrize(("nx", "ny"), [(12, 8), (9, 8), (12, 7), (31, 3), (5, 1)])
def test_coarse_periodic_cells_are_centred_on_their_children(nx, ny):
    grid = Grid(nx, ny, 0.3, 2.0, 5.0, -1.0, "spectral")
    coarse = grid.coarsen(1)
    assert coarse.area == pytest.approx(grid.area)
    for axis, (a, b) in zip("yx", grid.places_in(coarse), strict=True):
        n, d = getattr(grid, f"n{axis}"), getattr(grid, f"d{axis}")
        of, wide = getattr(coarse, axis)(), getattr(coarse, f"d{axis}")
        fine = getattr(grid, axis)()
        np.testing.assert_allclose(of[0] + wide * (a * np.arange(n) + b), fine, rtol=0, atol=1e-12 * n * d)
        children = [fine[2 * j : 2 * j + 2].mean() for j in range(len(of))] if n > 1 else fine
        assert abs(of - children).max() <= 0.5 * d * (n % 2) + 1e-12 * n * d


@pytest.mark.parametrize(("nx", "ny"), [(7, 3), (1, 5)])
def test_cells_fill_the_domain(nx, ny):
    domain = -0.3, 1.9, 4.0, 4.7
    grid = Grid.from_domain(nx, ny, domain)
    assert grid.domain == pytest.approx(domain, rel=1e-14)
    assert grid.sides == pytest.approx((2.2, 0.7), rel=1e-14)
    assert grid.area == pytest.approx(2.2 * 0.7, rel=1e-14)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("whole numbers", lambda: Grid.from_domain(16.5, 12, (0, 1, 0, 1))),
        ("at least one cell", lambda: Grid(8, 0, 1.0, 1.0)),
        ("positive", lambda: Grid(8, 8, 0.0, 1.0)),
        ("finite", lambda: Grid(8, 8, 1.0, np.nan)),
        ("spectral", lambda: Grid(8, 8, 1.0, 1.0, periodic="yes")),
        ("four numbers", lambda: Grid.from_domain(16, 12, "0,1,0,1")),
    ],
)
def test_wrong_grids_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)
