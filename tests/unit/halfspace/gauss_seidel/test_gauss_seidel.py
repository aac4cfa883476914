"""Gauss-Seidel sweeps against the scalar double loop."""

import tracemalloc

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import GRIDS, block_sizes, empty_in_the_middle, make, random_problem, sweep

from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.kernel import UNIT

each_grid = pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS.keys())

MEASURED = 1e-13  # relative, against the scalar loop: 1e-14 at most is seen


@numba.njit
def scalar_loop(kernel, r, mask, omega):
    """One cell after the other, with what has been solved already."""
    ny, nx = r.shape
    d = np.zeros((ny, nx))
    for j in range(ny):
        for i in range(nx):
            if mask[j, i]:
                total = r[j, i]
                for b in range(j + 1):
                    for a in range(nx if b < j else i):
                        total -= kernel[j - b, abs(i - a)] * d[b, a]
                d[j, i] = omega / kernel[0, 0] * total
    return d


def expected_sweep(grid, r, mask, omega, backward):
    kernel = influence_quadrant(grid, UNIT)
    if backward:
        return scalar_loop(kernel, r[::-1, ::-1].copy(), mask[::-1, ::-1].copy(), omega)[::-1, ::-1]
    return scalar_loop(kernel, r, mask, omega)


def assert_exact(grid, r, mask, omega, relaxation=None):
    relaxation = relaxation or make(grid)
    for backward in (False, True):
        expected = expected_sweep(grid, r, mask, omega, backward)
        found = sweep(relaxation, r, mask, omega, backward)
        assert np.abs(found - expected).max() <= MEASURED * np.abs(expected).max()
        assert (found[~mask] == 0).all()


def ellipse(grid):
    """The contact set of a Hertz contact, a third of the patch."""
    x, y = ((np.arange(n) + 0.5) / n - 0.5 for n in (grid.nx, grid.ny))
    return (x / 0.4) ** 2 + (y[:, None] / 0.266) ** 2 < 1


@each_grid
@pytest.mark.parametrize("omega", [0.3, 0.8, 1.0, 1.9])
def test_sweep_equals_scalar_loop(grid, omega):
    relaxation = make(grid)
    for share in (0.4, 1.1, 0.02):
        assert_exact(grid, *reversed(random_problem(grid, share)), omega, relaxation)
    assert_exact(grid, *reversed(empty_in_the_middle(grid)), omega, relaxation)


@settings(max_examples=60, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    aspect=st.sampled_from([0.02, 1.0, 7.0]),
    share=st.sampled_from([0.01, 0.1, 0.5, 1.1]),
    omega=st.floats(0.05, 1.95),
    blocks=st.tuples(st.integers(1, 12), st.integers(1, 20)),
    seed=st.integers(0, 1000),
)
def test_sweep_is_exact_for_all_block_sizes(shape, aspect, share, omega, blocks, seed):
    ny, nx = shape
    grid = Grid(nx, ny, 0.1, 0.1 * aspect)
    mask, r = random_problem(grid, share, seed)
    with block_sizes(*blocks):
        assert_exact(grid, r, mask, omega)


def test_sweep_is_exact_as_contact_widens_and_narrows():
    """Columns without contact are left out: all is prepared anew when contact grows, and kept when it shrinks."""
    grid, rng = Grid(331, 30, 0.3, 0.2), np.random.default_rng(5)
    relaxation = make(grid)
    # Some rows without holes, long enough for transforms.
    for first, last in ((40, 230), (100, 130), (17, 331), (0, 40)):
        mask = np.zeros(grid.shape, bool)
        mask[4:28, first:last] = rng.random((24, last - first)) < 0.5
        mask[20:22, first:last] = True
        assert_exact(grid, rng.normal(size=grid.shape), mask, 0.8, relaxation)


def test_sweep_ignores_defect_outside_changed_contact_sets():
    grid = GRIDS["prime"]
    relaxation = make(grid)
    mask, _ = random_problem(grid)
    r = np.random.default_rng(3).normal(size=grid.shape)
    before = sweep(relaxation, r, mask, 0.8)
    assert (sweep(relaxation, r * mask, mask, 0.8) == before).all()
    kept = mask.copy()
    mask[grid.ny // 3 :] = False
    assert_exact(grid, r, mask, 0.8, relaxation)
    assert (sweep(relaxation, r, kept, 0.8) == before).all()
    assert (sweep(relaxation, r, np.zeros_like(mask), 0.8) == 0).all()


@pytest.mark.parametrize("shape", [(256, 256), (300, 500), (512, 512)])
def test_sweep_holds_few_fields(shape):
    ny, nx = shape
    r, mask = np.ones(shape), np.ones(shape, bool)
    sweep(make(Grid(nx, ny, 0.1, 0.1)), r, mask, 0.8)  # what is compiled, and kept for any grid
    relaxation = make(Grid(nx, ny, 0.1, 0.1))
    tracemalloc.start()
    try:
        sweep(relaxation, r, mask, 0.8)
        held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert 1 <= held / (8 * nx * ny) <= 5


def test_cost_of_sweep_in_products_grows_slowly():
    costs = []
    for n in (128, 256, 512):
        grid = Grid(n, n, 0.1, 0.1)
        relaxation = make(grid)
        mask = ellipse(grid)
        sweep(relaxation, mask * 1.0, mask, 0.8)
        costs.append(relaxation.products_per_sweep)
        sweep(relaxation, mask * 1.0, mask, 0.8, backward=True)
        assert relaxation.products_per_sweep == pytest.approx(costs[-1], rel=0.05)
    assert 0.5 < costs[0] < costs[1] < costs[2] < 2
    assert costs[2] - costs[1] < 0.5


def test_empty_rows_cost_nothing():
    grid = Grid(200, 256, 0.1, 0.1)
    mask, r = random_problem(grid)
    whole, upper, none = make(grid), make(grid), make(grid)
    sweep(whole, r, mask, 0.8)
    mask[: grid.ny // 2] = False
    sweep(upper, r, mask, 0.8)
    sweep(none, r, np.zeros_like(mask), 0.8)
    assert none.products_per_sweep == 0
    assert upper.products_per_sweep < 0.5 * whole.products_per_sweep
