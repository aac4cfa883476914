"""Sweeps with the centre of B."""

from dataclasses import replace

import numpy as np
import pytest

from app.halfspace.grid import Grid
from app.methods.periodic import stencil

WEIGHTS = 0.7, *(np.float32(w) for w in (-0.19, -0.16, -0.04))


SHAPES = (8, 12), (4, 64), (1, 8), (8, 1), (2, 4), (12, 2), (5, 7), (3, 33)


SINGLE = 2e-6


each_shape = pytest.mark.parametrize("shape", SHAPES, ids=[f"{ny}x{nx}" for ny, nx in SHAPES])


SHARES = np.array([1.1, 0.7, 0.9, 1.3, 0.8, 1.0, 0.6, 1.2], np.float32)


each_count = pytest.mark.parametrize("steps", [1, 2, 3, 5, 8])


def neighbours(x, weights=WEIGHTS):
    """Return the stencil sum of the eight neighbours of each cell, periodic."""
    _, wx, wy, wd = weights

    def beside(field, axis):
        return np.roll(field, 1, axis) + np.roll(field, -1, axis)

    return wx * beside(x, 1) + wy * beside(x, 0) + wd * beside(beside(x, 0), 1)


def swept(source, free, shares, x):
    """Do Richardson steps."""
    for share in shares:
        x = free * (x + share * (source - neighbours(x) - x))
    return x


def fields(shape, seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape), rng.random(shape) < 0.6


def slabs_of(shape, width):
    """Yield the slabs of two ranks with their halos."""
    cut = shape[0] // 3 if shape[0] > 2 else 0
    for a, b in ((0, cut), (cut, shape[0])):
        before, after = (np.arange(first, first + width) % shape[0] for first in (a - width, b))
        yield slice(a, b), before, after


def no_x(nx):
    """Return empty fields in place of a start."""
    return (np.empty((0, nx), np.float32),) * 3


def no_waves(nx):
    """Return empty fields in place of long waves."""
    return np.empty((0, 0)), ((1.0, 0.0), (1.0, 0.0)), (np.empty(0, np.float32), np.empty(nx, np.float32))


FACTORS = (1, 1), (2, 2), (4, 4), (1, 2), (4, 1), (2, 4)


@each_shape
@pytest.mark.parametrize("factors", FACTORS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_means_over_coarse_cells_add_up_over_slabs(shape, factors, dtype):
    (s, free), (fy, fx) = fields(shape, 1), factors
    s = s.astype(dtype)
    x = (free * fields(shape, 2)[0]).astype(np.float32)
    coarse = np.zeros((3, *(-(-n // f) for n, f in zip(shape, factors, strict=True))))
    for rows, before, after in slabs_of(shape, 2):
        parts = np.full((3, -(-rows.stop // fy) - rows.start // fy, coarse.shape[2]), np.nan)
        place = rows.start % fy, factors, np.empty(shape[1], np.float32)
        stencil.free_in_cells(s[rows], free[rows], 0.7, parts[0], *place)
        stencil.contact_in_cells(free[rows], parts[1], *place)
        three = np.zeros((3, shape[1] + 2), np.float32)
        around = x[rows], x[before], x[after]
        stencil.residual_in_cells(
            s[rows], free[rows], WEIGHTS, *around, parts[2], *place[:2], three, place[2]
        )
        coarse[:, rows.start // fy :][:, : parts.shape[1]] += parts
    left = free * (WEIGHTS[0] * s - x - neighbours(x))
    for field, result in zip((0.7 * s * free, ~free, left), coarse, strict=True):
        filled = np.zeros([n * f for n, f in zip(result.shape, factors, strict=True)])
        filled[: shape[0], : shape[1]] = field  # the last coarse cells may have fewer children
        expected = filled.reshape(len(result), fy, -1, fx).mean((1, 3))
        np.testing.assert_allclose(result, expected, rtol=0, atol=SINGLE)


@each_shape
@each_count
@pytest.mark.parametrize("start", [False, True], ids=["from zero", "from a field"])
def test_sweeps_are_richardson_steps(shape, steps, start):
    (s, free), shares = fields(shape, steps), SHARES[:steps]
    x = (start * free * fields(shape, 99)[0]).astype(np.float32)
    expected = swept(free * s * WEIGHTS[0], free, shares, x)
    if start:
        shares = np.append(np.float32(0), shares)
    results = [np.full(shape, np.nan), x.copy()]  # z may be x
    work = stencil.make_work(len(shares), shape[1])
    for rows, before, after in slabs_of(shape, len(shares) - 1):
        inside = s[rows], s[before], s[after], free[rows], free[before], free[after], WEIGHTS, shares
        for z in results if start else results[:1]:
            sweeps = (results[1][rows], x[before], x[after]) if start else no_x(shape[1])
            stencil.sweep(*inside, *sweeps, *no_waves(shape[1]), z[rows], work)
    for z in results if start else results[:1]:
        np.testing.assert_allclose(z, expected, rtol=0, atol=SINGLE * abs(expected).max())
        assert (z[~free] == 0).all()


@each_shape
@each_count
@pytest.mark.parametrize("more", [0, 3])
@pytest.mark.parametrize("capped", [False, True], ids=["free", "capped"])
def test_projected_sweeps_keep_the_pressure_within_its_bounds(shape, steps, more, capped):
    f, low = (fields(shape, seed)[0].astype(np.float32) for seed in (steps, 50))
    low[fields(shape, 51)[1]] = -np.inf
    room = abs(fields(shape, 52)[0]).astype(np.float32) if capped else np.full(shape, np.float32(np.inf))
    room[fields(shape, 53)[1]] = np.inf
    expected, y = 0, f
    for _ in range(steps):
        expected = np.maximum(y, np.minimum(low, y + room))
        y = f - neighbours(expected)
    work = stencil.make_projected_work(steps, shape[1], room if capped else None)
    x = np.full(shape, np.nan, np.float32)
    for rows, before, after in slabs_of(shape, steps - 1 + more):
        three = [(field[rows], field[before], field[after]) for field in (f, low, room)]
        three[2] = three[2] if capped else (None,) * 3
        stencil.sweep_projected(*three[0], *three[1], *three[2], WEIGHTS, steps, x[rows], work)
    np.testing.assert_allclose(x, expected, rtol=0, atol=SINGLE * abs(expected).max())
    assert capped or (x >= low).all()


def coarsened(grid, factors):
    """Return the grid of cells larger by factors."""
    while max(factors) > 1:
        halved = grid.coarsen(1)
        halved = replace(
            grid,
            **{name: getattr(halved, name) for name in ("ny", "dy", "y0") if factors[0] > 1},
            **{name: getattr(halved, name) for name in ("nx", "dx", "x0") if factors[1] > 1},
        )
        grid, factors = halved, tuple(max(factor // 2, 1) for factor in factors)
    return grid


def bilinear(places, n, count):
    """Return the matrix of periodic interpolation from `count` cells to n."""
    centre = places[0] * np.arange(n) + places[1]
    below, matrix = np.floor(centre).astype(int), np.zeros((n, count))
    np.add.at(matrix, (np.arange(n), below % count), below + 1 - centre)
    np.add.at(matrix, (np.arange(n), (below + 1) % count), centre - below)
    return matrix


@pytest.mark.parametrize("steps", [1, 3, 8])
@pytest.mark.parametrize("factors", FACTORS)
@pytest.mark.parametrize("shape", [(8, 12), (4, 4), (4, 24), (7, 10), (6, 13)])
def test_long_waves_are_interpolated_and_added_to_the_first_sweep(shape, factors, steps):
    (s, free), shares, beside = fields(shape, 1), SHARES[:steps], steps - 1
    grid = Grid(shape[1], shape[0], 0.5, 2.0, periodic="spectral")
    below = coarsened(grid, factors)
    (ay, by), in_x = grid.places_in(below)
    coarse = fields(below.shape, 2)[0]
    z, work = np.full(shape, np.nan, np.float32), stencil.make_work(steps, shape[1])
    for rows, before, after in slabs_of(shape, beside):
        low = int(np.floor(ay * (rows.start - beside) + by))
        high = int(np.floor(ay * (rows.stop - 1 + beside) + by)) + 3  # one more, should rounding ask for it
        around = coarse[np.arange(low, high) % len(coarse)]
        places = (ay, ay * (rows.start - beside) + by - low), in_x
        of_waves = np.empty(below.nx + 2, np.float32), np.empty(shape[1], np.float32)
        outside = s[before], s[after], free[rows], free[before], free[after]
        stencil.sweep(
            s[rows], *outside, WEIGHTS, shares, *no_x(shape[1]), around, places, of_waves, z[rows], work
        )
    source = free * s * WEIGHTS[0]
    waves = bilinear((ay, by), shape[0], below.ny) @ coarse @ bilinear(in_x, shape[1], below.nx).T
    expected = swept(source, free, shares[1:], shares[0] * source + free * waves)
    np.testing.assert_allclose(z, expected, rtol=0, atol=SINGLE * abs(expected).max())


@pytest.mark.parametrize("cut", [0, 2, 5])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_add_centre_multiplies_by_the_stencil(cut, dtype):
    """Columns are periodic; only the nearest halo rows count."""
    rng = np.random.default_rng(2)
    d, weights = rng.normal(size=(5, 6)).astype(dtype), (0.5, 0.3, -0.2, 0.1)
    around = np.pad(d, 1, mode="wrap").astype(float)
    expected = 2 * sum(
        (1.0, 0.3, -0.2, 0.1)[abs(x) + 2 * abs(y)] * around[1 + y : 6 + y, 1 + x : 7 + x]
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
    )
    result = np.ones((5, 6))
    for rows in (slice(0, cut), slice(cut, 5)):
        before, after = np.roll(d, -rows.start, 0)[-2:], np.roll(d, -rows.stop, 0)[:2]
        if rows.start < rows.stop:
            stencil.add_centre(d[rows], before, after, weights, np.empty((3, 8)), result[rows])
    np.testing.assert_allclose(result, 1 + expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("loop", ["add_centre", "residual_in_cells"])
def test_loops_without_rows_read_no_memory(loop):
    """The row before the first one would be outside the array."""
    none, weights = np.zeros((0, 4)), (1.0, *(np.float32(0),) * 3)
    arguments = {
        "add_centre": (none, none, none, weights, np.zeros((3, 6)), none),
        "residual_in_cells": (
            none, none > 0, weights, none, none, none, none, 0, (1, 1), np.zeros((3, 6)), np.zeros(4),
        ),
    }  # fmt: skip
    getattr(stencil, loop).py_func(*arguments[loop])
