"""Filled points: against dense solutions, planes, periods, other cells, and the load they carry."""

from itertools import product

import numpy as np
import pytest

from app import ContactProblem, Grid, Material, read_surface, solve
from app.problems.surfaces.moments import LEVELS

NY, NX = 12, 15
X, Y = np.arange(NX), np.arange(NY)[:, None]
PLANE = 3e3 + 40 * X - 25 * Y
HOLES = {
    "row": np.s_[-1],
    "columns": np.s_[:, :2],
    "corner": np.s_[:5, 9:],
    "block": np.s_[4:9, 3:8],
    "cell": np.s_[0, 7],
    "all but three rows": np.s_[3:],
}


def holed(heights, where):
    heights = np.array(heights, float)
    heights[where] = np.nan
    return heights


def read(heights, level="none", missing="fill", periodic=False):
    return read_surface(heights, "mm", level, missing=missing, spacing=(1, 1), periodic=periodic)


def best(heights, level):
    """Least squares polynomial of a level, by an orthogonal factorisation."""
    x, y = (2 * np.arange(n) / n for n in heights.shape[::-1])
    basis = np.stack([np.multiply.outer(y**m, x**k) for k, m in LEVELS[level]] or [0 * heights], axis=-1)
    known = ~np.isnan(heights)
    return np.nan_to_num(basis) @ np.linalg.lstsq(np.nan_to_num(basis)[known], heights[known], rcond=None)[0]


def harmonic(heights, periodic):
    """Missing heights as means of their neighbours, by dense equations."""
    places = {tuple(place): n for n, place in enumerate(np.argwhere(np.isnan(heights)))}
    matrix, right = np.zeros((len(places),) * 2), np.zeros(len(places))
    for (j, i), n in places.items():
        for neighbour in ((j + 1, i), (j - 1, i), (j, i + 1), (j, i - 1)):
            if periodic:
                neighbour = neighbour[0] % heights.shape[0], neighbour[1] % heights.shape[1]
            if 0 <= neighbour[0] < heights.shape[0] and 0 <= neighbour[1] < heights.shape[1]:
                matrix[n, n] += 1
                if neighbour in places:
                    matrix[n, places[neighbour]] -= 1
                else:
                    right[n] += heights[neighbour]
    filled = heights.copy()
    filled[np.isnan(heights)] = np.linalg.solve(matrix, right)
    return filled


@pytest.mark.parametrize("case", range(40))
def test_filled_points_are_harmonic_about_the_best_plane(case):
    rng = np.random.default_rng(case)
    level, periodic = list(product(LEVELS, [False, True]))[case % 8]
    ny, nx = rng.integers(4, 14, 2)
    x, y = np.arange(nx), np.arange(ny)[:, None]
    tilt, bow = rng.normal(size=2) * rng.choice([1, 100]), rng.choice([0, 0.1])
    heights = 50 + tilt[0] * x + tilt[1] * y + bow * (x - 5) ** 2 - bow * x * y + rng.normal(size=(ny, nx))
    missing = rng.random((ny, nx)) < rng.choice([0.02, 0.2, 0.5])
    missing[:: ny - 1] |= rng.random(nx) < 0.8
    missing[: ny // 2, : nx // 3] = missing[0, 0] = True
    levelled = holed(heights, missing)
    levelled -= best(levelled, level)
    plane = best(levelled, "mean" if periodic else "plane")
    expected = harmonic(levelled - plane, periodic) + plane
    filled = read(holed(heights, missing), level, periodic=periodic).heights()
    np.testing.assert_allclose(filled, expected, rtol=0, atol=1e-10 * np.abs(heights).max())
    left = (filled - plane)[missing], (levelled - plane)[~missing]
    assert left[1].min() <= left[0].min() and left[0].max() <= left[1].max()


def test_a_periodic_problem_fills_around_its_period_however_its_map_was_read():
    wave = np.cos(2 * np.pi * np.arange(32) / 32) + np.zeros((8, 1))
    surface = read(holed(wave, np.s_[:, :3]))
    problem = ContactProblem(
        surface.grid(), Material.from_contact_modulus(1e3), surfaces=[surface], periodic=True
    )
    expected = read(holed(wave, np.s_[:, :3]), periodic=True)
    np.testing.assert_array_equal(-problem.shape_on(problem.grid), expected.heights())
    resampled = surface.resampled().heights_on(problem.grid)
    np.testing.assert_allclose(resampled, expected.heights(), atol=1e-13)
    assert np.abs(surface.heights() - expected.heights()).max() > 0.01  # of a free patch


@pytest.mark.parametrize("missing", ["hole", "fill"])
@pytest.mark.parametrize("where", HOLES)
def test_planes_are_kept_on_other_cells(where, missing):
    surface = read(holed(PLANE, HOLES[where]), missing=missing)
    for cells in ((NX, NY), (22, 7)):
        grid = Grid.from_domain(*cells, (0, NX, 0, NY))
        plane = 3e3 + 40 * (grid.x() - 0.5) - 25 * (grid.y()[:, None] - 0.5)
        heights = surface.resampled().heights_on(grid)
        known = ~np.isnan(heights)
        assert known.all() or missing == "hole"
        np.testing.assert_allclose(heights[known], plane[known], rtol=1e-11)
    heights = surface.averaged((3, 5)).heights()
    known = ~np.isnan(heights)
    np.testing.assert_allclose(heights[known], PLANE.reshape(3, 4, 5, 3).mean(axis=(1, 3))[known], rtol=1e-11)


@pytest.mark.parametrize("cells", [None, (16, 16), (30, 40)])
def test_the_load_on_filled_points_is_noted(cells):
    """A summit that was not measured; one outside of the contact carries nothing."""
    x = np.linspace(-1, 1, 32)
    cap = -(x**2) - x[:, None] ** 2
    for where, carries in ((np.s_[13:18, 13:18], True), (np.s_[:, :2], False)):
        surface = read_surface(holed(cap, where), "um", missing="fill", spacing=(1e-3, 1e-3))
        if cells:
            surface = surface.averaged(cells) if cells[0] == 16 else surface.resampled()
        grid = Grid.from_domain(*(cells or (32, 32)), (-0.016, 0.016, -0.016, 0.016))
        problem = ContactProblem(grid, Material.from_contact_modulus(1e3), surfaces=[surface])
        solution = solve(problem, load=4e-4)
        shares = [
            float(note.split(": ")[1].split("%")[0])
            for note in solution.notes
            if "load is carried by" in note
        ]
        if carries:
            share = surface.filled_on(grid)
            expected = np.vdot(share, solution.pressure) / solution.pressure.sum()
            assert shares == [pytest.approx(100 * expected, rel=0.05)] and expected > 0.1
        else:
            assert not shares
