"""Kernel of a pressure that repeats in one direction, against sums over its copies."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.halfspace import one_way_kernel
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix, influence_quadrant
from app.halfspace.kernel import UNIT, Kernel
from app.halfspace.layer import Layer
from app.halfspace.layer_coefficients import LayerTables
from app.halfspace.love import love_coefficients
from app.halfspace.material import Material
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.operator import InfluenceOperator

COPIES = 2000
ROUNDING = 2e-14  # of the largest coefficient; measured: 9e-15
GRIDS = [
    Grid(8, 16, 0.125, 0.0625, periodic="y"),
    Grid(12, 7, 0.83, 0.125, periodic="y"),
    Grid(5, 1, 0.6, 1.0, periodic="y"),
    Grid(6, 2, 8.3, 0.5, periodic="y"),  # cells wider than the period
    Grid(6, 64, 0.0083, 1 / 64, periodic="y"),
    Grid(7, 5, 0.35, 0.2, periodic="y"),
    Grid(17, 1, 0.03, 1.0, periodic="y"),
]
each_grid = pytest.mark.parametrize("grid", GRIDS, ids=lambda grid: f"{grid.nx}x{grid.ny}")


def sum_of_copies(grid):
    """Coefficients for unit compliance: Love's of 4001 copies, and the rest by Euler and Maclaurin."""
    period, datum = grid.sides[1], patch_kernel(UNIT, grid).datum
    rows, total = np.arange(grid.ny), np.zeros(grid.shape)
    for copy in range(-COPIES, COPIES + 1):
        distances = np.abs(rows + copy * grid.ny)
        total += love_coefficients((grid.dx, grid.dy), 1.0, distances, grid.nx)
    end = (COPIES + 0.5) * period  # copies beyond it are a line of force from there on
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x = (np.arange(grid.nx)[:, None] + nodes / 2) * grid.dx
    line = 2 * np.log((end + np.hypot(end, x)) / datum) @ weights / 2
    slope = end / np.hypot(end, x) ** 3 @ weights / 2
    squares = (grid.dy**2 / 12 + (rows * grid.dy) ** 2 - period**2 / 12)[:, None]
    return total + grid.cell_area / period * (squares * slope - line)


@each_grid
def test_coefficients_are_sums_over_copies(grid):
    expected = sum_of_copies(grid)
    np.testing.assert_allclose(
        influence_quadrant(grid, UNIT), expected, rtol=0, atol=ROUNDING * expected.max()
    )


@each_grid
def test_coefficients_do_not_depend_on_where_waves_take_over(grid, monkeypatch):
    expected = influence_quadrant(grid, UNIT)
    monkeypatch.setattr(one_way_kernel, "_NEAR", 0.4)
    one_way_kernel._wave_integrals.cache_clear()
    later = influence_quadrant(grid, UNIT)
    one_way_kernel._wave_integrals.cache_clear()
    np.testing.assert_allclose(later, expected, rtol=0, atol=ROUNDING * expected.max())


@each_grid
def test_exchanging_x_and_y_transposes_coefficients(grid):
    other = Grid(grid.ny, grid.nx, grid.dy, grid.dx, periodic="x")
    assert np.array_equal(influence_quadrant(other, UNIT), influence_quadrant(grid, UNIT).T)


@each_grid
def test_matrix_is_positive_and_its_bounds_hold(grid):
    kernel, matrix = patch_kernel(UNIT, grid), dense_matrix(grid, UNIT)
    assert matrix.min() > 0 and kernel.is_positive(grid)
    assert np.linalg.eigvalsh(matrix).min() >= kernel.smallest_eigenvalue(grid)
    sides = grid.sides[::-1]
    assert matrix.sum(axis=1).max() <= kernel.middle_displacement([2 * side for side in sides])
    strip = kernel.middle_displacement(sides)
    if grid.nx % 2:
        assert matrix.sum(axis=1).max() == pytest.approx(strip, rel=1e-13)


def test_rows_of_the_period_and_parts_of_it_have_equal_coefficients():
    """Windows have parts of the period, and coarse grids other cells."""
    grid = GRIDS[1]
    kernel = patch_kernel(UNIT, grid)
    part = Grid(grid.nx, 3, grid.dx, grid.dy)
    assert np.array_equal(influence_quadrant(part, kernel), influence_quadrant(grid, kernel)[:3])
    around = kernel.unit_coefficients(grid, np.arange(grid.ny, 2 * grid.ny), np.arange(grid.nx))
    assert np.array_equal(around, influence_quadrant(grid, kernel))
    joined = influence_quadrant(Grid(6, 7, 2 * grid.dx, grid.dy, periodic="y"), kernel)
    centre = influence_quadrant(grid, kernel)
    # Displacements far away depend little on the size of a cell under the same load.
    assert joined[0, 5] / 2 == pytest.approx(centre[0, 10], rel=1e-2)


BODIES = {
    "soft base": Material.coated((2.0, 1.0), (0.3, 0.3), 0.2, other=(5.0, 0.1)),
    "stiff base": Material.coated((1.0, 10.0), (0.4, 0.2), 0.2),
    "rigid base": Material.layer(1.0, 0.5, 0.2),
    "hard": Material.coated((100.0, 1.0), (0.3, 0.3), 0.05),
    "thick": Material.coated((1.0, 0.1), (0.3, 0.3), 20.0),
}
each_body = pytest.mark.parametrize("material", BODIES.values(), ids=BODIES.keys())


def displaced(grid, material, pressure):
    u = np.empty(grid.shape)
    InfluenceOperator(grid, material.kernel).exact_displacement(pressure, u)
    return u


@each_body
def test_waves_along_the_period_displace_layers_as_on_a_periodic_patch(material):
    """Across the period their displacement decays, so that copies in this direction do not matter."""
    grid, wide = Grid(10, 12, 0.11, 1 / 12, periodic="y"), Grid(96, 12, 0.11, 1 / 12, periodic="love")
    pressure = np.random.default_rng(0).normal(size=grid.shape)
    pressure -= pressure.mean(axis=0)
    padded = np.zeros(wide.shape)
    padded[:, : grid.nx] = pressure
    u = displaced(grid, material, pressure)
    expected, largest = (
        displaced(wide, material, padded)[:, : grid.nx],
        dense_matrix(grid, material.kernel).max(),
    )
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9 * largest)


@each_body
def test_plane_strain_of_layers_is_that_of_a_long_periodic_patch(material):
    """Pressures without moments up to the third: displacements by their copies are negligible."""
    grid, long = Grid(10, 1, 0.11, 1.0, periodic="y"), Grid(4096, 1, 0.11, 1.0, periodic="love")
    pressure, padded = np.zeros(grid.shape), np.zeros(long.shape)
    pressure[0, 2:7] = 1, -4, 6, -4, 1
    padded[:, : grid.nx] = pressure
    u, expected = displaced(grid, material, pressure), displaced(long, material, padded)[:, : grid.nx]
    expected += u[0, 0] - expected[0, 0]  # on a periodic patch without mean
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9 * abs(u).max())


@each_body
def test_layers_keep_the_matrix_positive_and_its_bounds(material):
    for grid in (Grid(10, 12, 0.11, 1 / 12, periodic="y"), Grid(7, 4, 0.05, 0.4, periodic="y")):
        kernel, matrix = patch_kernel(material.kernel, grid), dense_matrix(grid, material.kernel)
        assert np.linalg.eigvalsh(matrix).min() >= kernel.smallest_eigenvalue(grid)
        assert kernel.is_positive(grid) == (matrix.min() >= 0)
        assert kernel.contrast(grid) == material.kernel.contrast(grid)
        other = Grid(grid.ny, grid.nx, grid.dy, grid.dx, periodic="x")
        assert np.array_equal(
            influence_quadrant(other, material.kernel), influence_quadrant(grid, material.kernel).T
        )


@pytest.mark.parametrize("stiffness", [1e3, 1e6])
@pytest.mark.parametrize("poisson", [(0.3, 0.3), (0.5, 0.0), (0.0, 0.5)])
def test_matrix_of_stiff_layers_is_positive(stiffness, poisson):
    """They spread a load over more than the patch."""
    for thickness in (0.01, 0.1, 1.0):
        material = Material.coated((stiffness, 1.0), poisson, thickness)
        assert (
            np.linalg.eigvalsh(dense_matrix(Grid(12, 6, 1 / 12, 1 / 6, periodic="y"), material.kernel)).min()
            > 0
        )


def test_equal_materials_are_a_half_space():
    grid, equal = Grid(10, 12, 0.11, 1 / 12, periodic="y"), Material.coated((1.0, 1.0), (0.3, 0.3), 0.2)
    body = Material.pair((1.0, np.inf), (0.3, 0.0))
    expected = influence_quadrant(grid, body.kernel)
    np.testing.assert_allclose(
        influence_quadrant(grid, equal.kernel), expected, rtol=0, atol=1e-13 * expected.max()
    )


def sum_of_waves(grid, layer):
    """The layer's part of coefficients for compliance 1, by its integral over waves."""
    (width, period), t, datum = (grid.dx, grid.sides[1]), layer.thickness, patch_kernel(UNIT, grid).datum
    x, excess, highest = width * np.arange(grid.nx), layer.long_wave_ratio - 1, 19 / t
    step = min(8 / (x[-1] + width), 0.5 / t)
    edges = np.append(
        step * np.append(0, np.geomspace(1e-9, 1, 31)), np.arange(2 * step, highest + step, step)
    )
    nodes, weights = np.polynomial.legendre.leggauss(16)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    p, weights = (middle + half * nodes).ravel(), (half * weights).ravel()
    weights *= width * np.sinc(p * width / (2 * np.pi))
    total = np.zeros(grid.shape)
    for k in range(int(highest * period / (2 * np.pi)) + 1):
        q = np.hypot(2 * np.pi / period * k, p)
        values = layer.ratio(q) - 1 - (0 if k else excess * np.exp(-2 * p * t))
        own = np.cos(np.outer(x, p)) @ (weights * values / q)
        if not k:
            low, high = (
                a * (np.log(datum / np.hypot(a, 2 * t)) + 1) - 2 * t * np.arctan(a / (2 * t))
                for a in (x - width / 2, x + width / 2)
            )
            own += excess * (high - low)
        along = np.cos(2 * np.pi * k * np.arange(grid.ny) / grid.ny) * np.sinc(k / grid.ny)
        total += (4 if k else 2) / grid.ny * along[:, None] * own
    return total


LAYERS = [
    ((1.0, 2.0), (0.3, 0.3)),
    ((1.0, 20.0), (0.5, 0.2)),
    ((1.0, 1e3), (0.3, 0.3)),
    ((40.0, 1.0), (0.45, 0.3)),
    ((1e3, 1.0), (0.3, 0.3)),
    ((1.0, np.inf), (0.3, 0.3)),
]
each_layer = pytest.mark.parametrize(("young", "poisson"), LAYERS)


@pytest.mark.parametrize(
    "grid",
    [
        *GRIDS[::2],
        Grid(7, 9, 0.5, 1 / 20, periodic="y"),
        Grid(24, 8, 1.0, 0.01, periodic="y"),  # long cells
        Grid(8, 24, 0.01, 1.0, periodic="y"),
        Grid(1, 1, 1.0, 0.1, periodic="y"),
    ],
    ids=lambda grid: f"{grid.nx}x{grid.ny}",
)
@each_layer
def test_coefficients_of_layers_are_sums_over_waves(grid, young, poisson):
    for thickness in (0.05, 0.3, 3.0):
        if thickness * 200 < max(grid.sides):
            continue
        layer, kernel = Layer(thickness, young, poisson), Material.coated(young, poisson, thickness).kernel
        expected = layer.plane_compliance * (influence_quadrant(grid, UNIT) + sum_of_waves(grid, layer))
        datum = patch_kernel(kernel, grid).datum / patch_kernel(UNIT, grid).datum  # larger for thick layers
        shift = 2 * grid.dx / grid.ny * np.log(datum) * layer.plane_compliance * layer.long_wave_ratio
        expected += shift
        found = influence_quadrant(grid, kernel)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * expected.max())


@each_layer
@pytest.mark.parametrize("direction", ["", "x", "y"])
def test_coefficients_of_layers_cost_the_same_for_all_cells(young, poisson, direction, monkeypatch):
    """Apart from the tables, which do not depend on the grid."""
    counts, rest = [], LayerTables.rest

    def counted(self, r):
        counts.append(np.size(r))
        return rest(self, r)

    monkeypatch.setattr(LayerTables, "rest", counted)
    for nx, ny, dx, dy in ((24, 8, 1.0, 0.01), (8, 24, 0.01, 1.0), (24, 24, 1.0, 1.0), (64, 2, 1e-3, 1.0)):
        for thickness in (1e-4, 1e-2, 1.0, 1e2):
            counts.clear()
            grid = Grid(nx, ny, dx, dy, periodic=direction)
            influence_quadrant(grid, Material.coated(young, poisson, thickness).kernel)
            assert sum(counts) < 300 * grid.n + 1e5


@each_grid
def test_vanishing_layers_leave_their_bases(grid):
    thickness = 1e-9 * min(grid.dx, grid.dy)
    coated = Material.coated((10.0, 1.0), (0.3, 0.4), thickness)
    substrate = influence_quadrant(grid, Material.pair((1.0, np.inf), (0.4, 0.0)).kernel)
    np.testing.assert_allclose(
        influence_quadrant(grid, coated.kernel), substrate, rtol=0, atol=1e-8 * substrate.max()
    )
    spring = influence_quadrant(grid, Material.layer(1.0, 0.3, thickness).kernel)
    assert spring[0, 0] == pytest.approx(thickness * 1.3 * 0.4 / 0.7, rel=1e-4)
    assert abs(spring).ravel()[1:].max(initial=0) < 1e-4 * spring[0, 0]


def test_other_kinds_of_bodies_are_refused():
    class Springs(Kernel):
        def unit_coefficients(self, grid, rows, columns):
            return np.zeros((len(rows), len(columns)))

    with pytest.raises(InputError, match="must be True or False with the kernel Springs"):
        patch_kernel(Springs(1.0), GRIDS[0])
