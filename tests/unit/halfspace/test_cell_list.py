"""Lists of cells, and sums over near cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.halfspace.cell_list import CellList, LocalSum, estimate_pairs
from app.halfspace.grid import Grid

SHAPES = st.tuples(st.integers(1, 12), st.integers(1, 40))


@settings(deadline=None)  # The first call loads a loop.
@given(mask=SHAPES.flatmap(lambda shape: arrays(bool, shape)))
def test_segments_contain_the_cells(mask):
    ny, nx = mask.shape
    grid = Grid(nx, ny, 1.0, 1.0)
    cells = CellList(grid, mask)
    np.testing.assert_array_equal(cells.cells, CellList(grid, np.flatnonzero(mask)).cells)
    assert len(cells) == mask.sum()
    segments = cells.segments
    bands = np.repeat(np.arange(len(segments.starts) - 1), np.diff(segments.starts))
    np.testing.assert_array_equal(segments.rows // 8, bands)
    places = (segments.rows * nx + 8 * segments.columns)[:, None] + np.arange(8)
    np.testing.assert_array_equal(places.ravel()[segments.slots], cells.cells)


@settings(deadline=None)  # The first call loads a loop.
@given(
    seed=st.integers(0, 999), shape=SHAPES, radii=st.tuples(st.integers(0, 12), st.integers(0, 40)),
    density=st.sampled_from([0.0, 0.05, 0.5, 1.0]),
)  # fmt: skip
def test_local_sum(seed, shape, radii, density):
    rng, (ny, nx) = np.random.default_rng(seed), shape
    grid = Grid(nx, ny, 1.0, 1.0)
    quadrant = rng.normal(size=[r + 1 for r in radii]) * (rng.random([r + 1 for r in radii]) < 0.7)
    quadrant[:, rng.integers(1, radii[1] + 2) :] = 0.0
    sources, targets = (CellList(grid, rng.random(shape) < density) for _ in range(2))
    p = rng.normal(size=len(sources))
    large = np.zeros((ny + radii[0], nx + radii[1]))
    large[: radii[0] + 1, : radii[1] + 1] = quadrant
    dy, dx = (np.abs(np.subtract.outer(getattr(targets, k), getattr(sources, k))) for k in ("iy", "ix"))
    expected = large[dy, dx] @ p
    out = np.ones(len(targets))
    found = LocalSum(quadrant).apply(sources, p, targets)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        LocalSum(quadrant).apply(sources, p, targets, out), found + 1, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("radius", [(10.0, 10.0), (40.0, 40.0), (15.0, 60.0), (600.0, 600.0)])
def test_estimated_pairs(radius):
    """Within a third of the number of pairs, which is enough to choose a method."""
    grid, rng = Grid(400, 300, 1.0, 1.0), np.random.default_rng(0)
    y, x = np.indices(grid.shape)
    spots = rng.integers(0, grid.shape, size=(12, 2))
    near = np.min([np.hypot(y - a, x - b) for a, b in spots], axis=0) < 9
    for mask in (near, rng.random(grid.shape) < 0.01):
        segments = CellList(grid, mask).segments
        iy = segments.rows
        dy, dx = (
            np.subtract.outer(iy, iy) / radius[0],
            np.subtract.outer(*[8 * segments.columns] * 2) / radius[1],
        )
        pairs = np.sum(np.hypot(dy, dx) <= 1)
        assert (
            pairs / 1.5 <= estimate_pairs(CellList(grid, mask), CellList(grid, mask), radius) <= 1.5 * pairs
        )
