"""Stress in a layered body: laws of elasticity, limits, and a point force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j0, j1

from app.base.errors import InputError
from app.halfspace import hankel
from app.halfspace.grid import Grid
from app.halfspace.layer import Layer
from app.halfspace.layer_waves import LayerWaves
from app.halfspace.stress import layer_tables
from app.halfspace.stress.layered import LayeredStress
from app.halfspace.stress.subsurface import SubsurfaceStress, horizontal_shear, max_shear, von_mises

GRID = Grid(13, 9, 0.3, 0.2, -1.0, 4.0)
PRESSURE = np.random.default_rng(1).random(GRID.shape)
TABLES = 1e-8  # error of stresses on free patches over the largest pressure
LAYERS = [
    Layer(0.5, (1.0, 10.0), (0.3, 0.2)),
    Layer(0.5, (10.0, 1.0), (0.25, 0.5)),
    Layer(0.5, (1.0, np.inf), (0.3, 0.0)),
]
layers = pytest.mark.parametrize("layer", LAYERS, ids=("soft", "hard", "rigid base"))
patches = pytest.mark.parametrize("periodic", ["", "y", "spectral"])


def below(layer, periodic="", pressure=PRESSURE, grid=GRID):
    return LayeredStress(pressure, replace(grid, periodic=periodic), layer)


@patches
@pytest.mark.parametrize("thickness", [0.01, 0.1, 1.0, 30.0])
def test_equal_materials_have_the_stress_of_a_half_space(periodic, thickness):
    layered = below(Layer(thickness, (7.0, 7.0), (0.3, 0.3)), periodic)
    plain = SubsurfaceStress(PRESSURE, layered.grid, 0.3)
    for depth in (0.0, 0.4 * thickness, thickness, 1.01 * thickness, 2.0):
        np.testing.assert_allclose(layered.plane(depth), plain.plane(depth), rtol=0, atol=TABLES)
    deep = thickness * np.array([1.2, 9.0])
    np.testing.assert_allclose(layered.section(deep, x=0.3), plain.section(deep, x=0.3), rtol=0, atol=TABLES)
    np.testing.assert_allclose(layered.line(deep, 0.3, 4.4), plain.line(deep, 0.3, 4.4), rtol=0, atol=TABLES)


@patches
@layers
def test_surface_carries_the_pressure_without_shear(layer, periodic):
    surface = below(layer, periodic).plane(0.0)
    np.testing.assert_allclose(surface[2], -PRESSURE, atol=1e-12)
    np.testing.assert_allclose(surface[4:], 0, atol=1e-12)


@patches
@pytest.mark.parametrize("layer", LAYERS[:2])
def test_interface_is_bonded(layer, periodic):
    """Tractions are continuous, and so are the strains in the plane."""
    body, t = below(layer, periodic), layer.thickness
    coating, substrate = (body.plane(t, side) for side in ("coating", "substrate"))
    np.testing.assert_allclose(coating[[2, 4, 5]], substrate[[2, 4, 5]], atol=TABLES)
    strains = []
    for stress, young, nu in zip((coating, substrate), layer.young, layer.poisson, strict=True):
        xx, yy, zz, xy, *_ = stress
        strains.append([(xx - nu * (yy + zz)) / young, (yy - nu * (xx + zz)) / young, (1 + nu) * xy / young])
    np.testing.assert_allclose(*strains, atol=TABLES)
    assert abs(coating - substrate)[[0, 1, 3]].max() > 0.05


@patches
@layers
@pytest.mark.parametrize("depth", [0.3, 0.9])
def test_divergence_of_the_stress_vanishes(layer, periodic, depth):
    """By central differences, whose error falls with the square of the step."""
    if layer.on_rigid_base and depth > layer.thickness:
        return
    # Without sawtooth waves, whose odd components are zero.
    pressure = np.exp(-3 * (GRID.x() - 1) ** 2) * (1 + np.cos(2 * np.pi / 1.8 * GRID.y()[:, None]) / 2)
    body, x, y = below(layer, periodic, pressure), 0.317, 4.83
    steps, forces = (0.08, 0.04), []
    for h in steps:
        in_x, in_y, in_z = (
            (
                body.line([depth + c * h], x + a * h, y + b * h)
                - body.line([depth - c * h], x - a * h, y - b * h)
            )[:, 0]
            / (2 * h)
            for a, b, c in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        )
        xx, yy, zz, xy, xz, yz = range(6)
        forces.append(
            [
                in_x[xx] + in_y[xy] + in_z[xz],
                in_x[xy] + in_y[yy] + in_z[yz],
                in_x[xz] + in_y[yz] + in_z[zz],
            ]
        )
    coarse, fine = np.abs(forces)
    assert coarse.max() < 0.05
    assert abs(4 * np.array(forces[1]) - forces[0]).max() / 3 < 0.1 * coarse.max() + 1e-6
    assert fine.max() < 0.3 * coarse.max() + 1e-6


@patches
def test_thin_coating_leaves_the_substrate_as_it_is_and_thick_one_is_the_body(periodic):
    thin, thick = (below(Layer(t, (3.0, 1.0), (0.2, 0.4)), periodic) for t in (1e-5, 1e7))
    one, other = (SubsurfaceStress(PRESSURE, thin.grid, nu) for nu in (0.4, 0.2))
    np.testing.assert_allclose(thin.plane(0.5), one.plane(0.5), atol=2e-4)
    np.testing.assert_allclose(thick.plane(0.5)[2:], other.plane(0.5)[2:], atol=1e-6)
    # On a periodic patch both are compressed by the mean pressure.
    np.testing.assert_allclose(thick.plane(0.5), other.plane(0.5), atol=1e-6)


@layers
@pytest.mark.parametrize("depth", [0.2, 0.5, 0.6, 3.0])
@pytest.mark.parametrize(("x", "y"), [(0.2, 0.1), (2.0, -0.7), (11.0, 5.0)])
def test_a_small_cell_is_a_point_force(layer, depth, x, y):
    """Its stress is a sum of Hankel transforms."""
    if layer.on_rigid_base and depth > layer.thickness:
        return
    side, r = 1e-3, np.hypot(x, y)
    cell = Grid(1, 1, side, side, -side / 2, -side / 2)
    found = below(layer, "", np.full((1, 1), side**-2), cell).line([depth], x, y)[:, 0]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = np.append(np.geomspace(1e-9, 0.1, 40), np.arange(0.2, 220, min(0.4, 4 / r)))
    half = np.diff(edges)[:, None] / 2
    q, weights = (edges[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel()
    value, slope, curvature = LayerWaves(layer, q).functions(depth)
    across = layer.poisson[int(depth > layer.thickness)] * (curvature - value)
    bessel = j0(q * r), j1(q * r), 2 * j1(q * r) / (q * r) - j0(q * r)

    def transform(function, order):
        return (weights * q * function) @ bessel[order] / (2 * np.pi)

    mean, turned = transform(curvature + across, 0) / 2, transform(across - curvature, 2) / 2
    cosine, sine = (x * x - y * y) / r**2, 2 * x * y / r**2
    shear = transform(slope, 1)
    expected = [
        *(mean + turned * cosine, mean - turned * cosine, -transform(value, 0), turned * sine),
        *(shear * x / r, shear * y / r),
    ]
    # Far away the tables are less accurate than this stress, but not than those below the contact.
    np.testing.assert_allclose(found, expected, atol=2e-5 * abs(np.array(expected)).max() + 3e-8)


@layers
def test_free_patch_is_the_middle_of_a_large_periodic_one(layer):
    """A mean pressure and the images remain; on a rigid base they do not reach the middle."""
    errors = []
    for times in (4, 8):
        wide = Grid.from_domain(16 * times, 16 * times, (-times, times, -times, times))
        pressure = np.exp(-8 * (wide.x() ** 2 + wide.y()[:, None] ** 2))
        free = below(layer, "", pressure, wide)
        uniform = [np.sinc(rate(16 * times)) for rate in (np.fft.rfftfreq, np.fft.fftfreq)]  # waves of cells
        of_cells = np.fft.irfft2(np.fft.rfft2(pressure) * np.outer(*uniform[::-1]), wide.shape)
        periodic = below(layer, "spectral", of_cells, wide)
        depths = [0.4, 0.5] + [0.7] * (not layer.on_rigid_base)
        errors.append(abs(free.line(depths, 0.1, 0.2) - periodic.line(depths, 0.1, 0.2)).max())
    if layer.on_rigid_base:
        assert errors[1] < 1e-6
    else:
        assert errors[1] < min(2e-3, 0.3 * errors[0])


@layers
@pytest.mark.parametrize("direction", ["x", "y"])
def test_stress_of_a_period_is_that_of_many_copies(layer, direction):
    """On a substrate, far copies act like line loads; on a rigid base they have no effect."""
    x, y = (np.arange(32) - 15.5) / 16, np.arange(16)[:, None] / 16
    loaded, depths, errors = np.exp(-40 * x**2), [0.3, 0.5] + [0.7] * (not layer.on_rigid_base), []
    grid = Grid(32, 16, 1 / 16, 1 / 16, periodic="y")
    for m in (4, 16):
        copies = replace(grid, ny=16 * (2 * m + 1), y0=-float(m), periodic="")
        cells = np.tile(loaded * (1.2 + np.cos(2 * np.pi * y)), (2 * m + 1, 1))
        expected = below(layer, "", cells, copies).section(depths, y=0.3)
        # The waves of a cell's pressure: along the period, and of the varying part also across it.
        wave = np.fft.irfft(np.fft.rfft(loaded) * np.sinc(np.fft.rfftfreq(32))) * np.sinc(1 / 16)
        pressure = 1.2 * loaded + wave * np.cos(2 * np.pi * y)
        if direction == "y":
            stress = below(layer, "y", pressure, grid).section(depths, y=0.3)
        else:
            turned = Grid(16, 32, 1 / 16, 1 / 16, periodic="x")
            stress = below(layer, "x", pressure.T, turned).section(depths, x=0.3)[[1, 0, 2, 3, 5, 4]]
        errors.append(abs(stress - expected).max())
    if layer.on_rigid_base:
        assert errors[1] < 1e-6
    else:
        assert errors[0] < 0.1 and errors[1] < errors[0] / 2.5


@layers
@pytest.mark.parametrize("depth", [0.2, 0.5, 0.6, 3.0])
def test_stress_by_a_roller_is_plane_strain(layer, depth):
    """The stress by a uniform strip is a sum of cosine and sine transforms."""
    if layer.on_rigid_base and depth > layer.thickness:
        return
    x, half_width = np.array([0.0, 0.3, 0.5, 1.9, 8.0]), 0.5
    grid = Grid(1, 4, 1.0, 0.5, -half_width, periodic="y")
    body = below(layer, "y", np.ones(grid.shape), grid)
    found = np.stack([body.line([depth], at, 0.1)[:, 0] for at in x], axis=1)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = np.append(np.geomspace(1e-12, 0.1, 40), np.arange(0.2, 220, 0.4))
    half = np.diff(edges)[:, None] / 2
    q, weights = (edges[:-1, None] + half * (1 + nodes)).ravel(), (half * weights).ravel()
    value, slope, curvature = LayerWaves(layer, q).functions(depth)
    strip = weights * 2 * np.sin(q * half_width) / (np.pi * q)
    cosine, sine = strip * np.cos(np.outer(x, q)), strip * np.sin(np.outer(x, q))
    xx, zz, nu = cosine @ curvature, -cosine @ value, layer.poisson[int(depth > layer.thickness)]
    np.testing.assert_allclose(found, [xx, nu * (xx + zz), zz, 0 * xx, sine @ slope, 0 * xx], atol=TABLES)


@layers
@pytest.mark.parametrize("thickness", [0.05, 2.0])
@pytest.mark.parametrize("periodic", ["", "y"])
def test_tables_are_as_accurate_as_stated(layer, thickness, periodic, monkeypatch):
    layer, depths = replace(layer, thickness=thickness), thickness * np.array([0.0, 1.0])
    if not layer.on_rigid_base:
        depths = np.append(depths, thickness * np.array([1.1, 4.0]))
    coarse = [below(layer, periodic).plane(depth) for depth in depths]
    monkeypatch.setattr(layer_tables, "_SPACING", 0.01)
    for name, value in (("_NEAR", 20.0), ("_PANEL", 0.15), ("_Y_PANEL", 2.0), ("_Y_MIDDLE", 55.0)):
        monkeypatch.setattr(hankel, name, value)
    tables = layer_tables._waves, layer_tables._table, layer_tables._strip_table
    for cached in tables:
        cached.cache_clear()
    try:
        for depth, plane in zip(depths, coarse, strict=True):
            np.testing.assert_allclose(plane, below(layer, periodic).plane(depth), rtol=0, atol=TABLES)
    finally:
        for cached in tables:
            cached.cache_clear()


@patches
@layers
def test_plane_section_and_line_agree(layer, periodic):
    body = below(layer, periodic)
    sides = ["coating"] if layer.on_rigid_base else ["coating", "substrate"]
    for side in sides:
        plane = body.plane(0.5, side)
        for found, expected in (
            (body.section(0.5, y=GRID.y()[4], side=side), plane[:, 4]),
            (body.section(0.5, x=GRID.x()[5], side=side), plane[:, :, 5]),
            (body.line(0.5, GRID.x()[5], GRID.y()[4], side), plane[:, 4, 5]),
        ):
            np.testing.assert_allclose(found.squeeze(), expected, atol=TABLES)


def test_depth_at_the_interface_is_on_the_chosen_side():
    body = below(LAYERS[1])
    coating, substrate = (body.plane(0.5, side) for side in ("coating", "substrate"))
    assert (body.plane(0.5) == coating).all()
    np.testing.assert_allclose(body.plane(0.5 - 1e-9), coating, atol=1e-7)
    np.testing.assert_allclose(body.plane(0.5 + 1e-9), substrate, atol=1e-7)
    assert (body.plane(np.nextafter(0.5, 1)) == substrate).all()
    with pytest.raises(InputError, match="side 'top': allowed: coating, substrate"):
        body.plane(0.5, "top")
    rigid = below(LAYERS[2])
    for depth, side in ((0.6, "coating"), (0.5, "substrate")):
        with pytest.raises(InputError, match="at most the thickness 0.5 mm"):
            rigid.line([0.1, depth], 0.0, 4.0, side)


@patches
@layers
def test_largest_stresses_are_those_found_by_looking_everywhere(layer, periodic):
    grid = Grid(24, 20, 0.1, 0.1, -1.0, -0.9, periodic=periodic)
    pressure = np.maximum(0, 1 - grid.x() ** 2 - 1.5 * grid.y()[:, None] ** 2) ** 0.5
    body = LayeredStress(pressure, grid, layer)
    maxima = body.layer_maxima()
    parts = [(maxima.coating, maxima.coating_interface, np.linspace(0, 0.5, 26), "coating")]
    if not layer.on_rigid_base:
        parts.append((maxima.substrate, maxima.substrate_interface, np.geomspace(0.5, 2, 40), "substrate"))
    else:
        assert maxima.substrate is maxima.substrate_interface is None
    planes = []
    for largest, at_interface, depths, side in parts:
        planes += [body.plane(depth, side) for depth in depths]
        most = max(von_mises(plane).max() for plane in planes[-len(depths) :])
        assert largest.von_mises == pytest.approx(most, rel=3e-3)
        assert at_interface.von_mises == pytest.approx(von_mises(body.plane(0.5, side)).max())
    assert maxima.shear.horizontal_shear == pytest.approx(horizontal_shear(body.plane(0.5)).max())
    hottest, sheared = body.maxima()
    assert hottest == body.maximum() and hottest.von_mises == max(part[0].von_mises for part in parts)
    assert sheared.max_shear == pytest.approx(max(max_shear(plane).max() for plane in planes), rel=3e-3)
