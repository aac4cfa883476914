"""S-filter and L-filter: what passes, what stays, edges, holes, wrong indices."""

import h5py
import numpy as np
import pytest

from app import ContactProblem, InputError, Material, read_surface
from app.problems.surfaces.filters import band_pass

from ..from_options import problem_from


def made(path, **texts):
    return problem_from(problem="rough", surface_file=path, **texts)


NX, NY = 120, 72
CELL = 0.5, 1.25  # sides of 60 and 90
X, Y = CELL[0] * np.arange(NX), CELL[1] * np.arange(NY)[:, None]
ROUGH = np.random.default_rng(3).normal(size=(NY, NX))


def share(filtered, wave):
    """Return the share of a wave that is left, and the largest other height."""
    left = float(np.vdot(filtered, wave) / np.vdot(wave, wave))
    return left, np.abs(filtered - left * wave).max()


@pytest.mark.parametrize("direction", ["x", "y", "both"])
@pytest.mark.parametrize("ratio", [0.5, 1, 2])
def test_a_wave_passes_as_the_standard_says(direction, ratio):
    """2^-(index/length)^2 of a wave in any direction: 1/2, at twice the index 2^-1/4, at half of it 2^-4."""
    lengths = {"x": (15, np.inf), "y": (np.inf, 15), "both": (15, 30)}[direction]
    length = 1 / np.hypot(*np.reciprocal(np.array(lengths, float)))
    wave = np.cos(2 * np.pi * (X / lengths[0] + Y / lengths[1]) + 0.3)
    low = band_pass(wave.copy(), length / ratio, None, CELL, periodic=True)
    assert share(low, wave) == pytest.approx((2 ** -(ratio**-2), 0), abs=1e-5)
    high = band_pass(wave.copy(), None, length / ratio, CELL, periodic=True)
    assert share(high, wave) == pytest.approx((1 - 2 ** -(ratio**-2), 0), abs=1e-5)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("holes", [False, True])
def test_constants_are_kept_to_the_sides_and_holes_stay(periodic, holes):
    heights = np.full((NY, NX), 1e6)
    if holes:
        heights[10:40, 20:90], heights[0, 0], heights[30, 50] = np.nan, np.nan, 1e6
    low = band_pass(heights.copy(), 9.0, None, CELL, periodic)
    np.testing.assert_array_equal(low, heights)
    high = band_pass(heights.copy(), None, 9.0, CELL, periodic)
    np.testing.assert_array_equal(high, 0 * heights)


@pytest.mark.parametrize("index", [9.0, 30.0])
def test_planes_are_kept_to_the_sides_and_to_holes(index):
    """To round-off, where points lie on a line or alone, too."""
    plane = 1e3 + 3 * X - 7 * Y
    for known in (np.ones((NY, NX), bool), ROUGH < 0.5, ROUGH > 2):
        heights = np.where(known, plane, np.nan)
        np.testing.assert_allclose(band_pass(heights.copy(), index, None, CELL), heights, atol=1e-11)
    heights = np.full((NY, NX), np.nan)
    for here in (np.s_[10:30, 40], np.s_[50, 60:90], (np.arange(40, 60), np.arange(20, 40)), np.s_[5, 100]):
        heights[here] = plane[here]
    np.testing.assert_allclose(band_pass(heights.copy(), index, None, CELL), heights, atol=1e-4)


def test_a_bowl_is_removed_at_the_rim_as_in_the_middle():
    """A paraboloid loses all but a constant in the middle, and hardly less at the rim, slope included."""
    bowl = 1e-3 * ((X - 30) ** 2 + (Y - 45) ** 2)
    left = band_pass(bowl.copy(), None, 12.0, CELL)
    middle, rim = left[NY // 2, NX // 2], np.r_[left[0], left[-1], left[:, 0], left[:, -1]]
    assert np.abs(rim - middle).max() < 2.5 * np.abs(middle) < 0.02 * np.ptp(bowl)


@pytest.mark.parametrize("periodic", [False, True])
def test_only_known_points_have_weight(periodic):
    """By direct sums: a plane on a free patch, a mean on a periodic one."""
    index, heights = 12.0, np.where(ROUGH > 1, np.nan, ROUGH)
    low = band_pass(heights.copy(), index, None, CELL, periodic)
    np.testing.assert_array_equal(np.isnan(low), np.isnan(heights))
    for j, i in np.argwhere(~np.isnan(heights))[:: NX * 3 + 1]:
        dx, dy = X - X[i], Y - Y[j]
        if periodic:
            dx, dy = (d - side * np.round(d / side) for d, side in ((dx, 60), (dy, 90)))
        weights = np.exp(-(np.log(2) ** -1) * (np.pi / index) ** 2 * (dx**2 + dy**2))
        weights = weights[known := ~np.isnan(heights)]
        columns = [np.broadcast_to(d, heights.shape)[known] for d in ((1.0,) if periodic else (1.0, dx, dy))]
        matrix = np.transpose(columns)
        best = np.linalg.solve(matrix.T @ (weights[:, None] * matrix), matrix.T @ (weights * heights[known]))
        assert low[j, i] == pytest.approx(best[0], abs=1e-8)


def test_a_profile_is_filtered_along_x_only():
    np.testing.assert_allclose(
        band_pass(ROUGH[:1].copy(), 4.0, None, CELL),
        band_pass(np.tile(ROUGH[0], (5, 1)), 4.0, None, CELL)[:1],
        atol=1e-12,
    )


@pytest.fixture
def saved(tmp_path):
    with h5py.File(tmp_path / "s.h5", "w") as file:
        file["heights"] = np.where(ROUGH > 2.5, np.nan, ROUGH + 0.1 * X)
        file["heights"].attrs.update(unit="nm", spacing=CELL, spacing_unit="um")
    np.save(tmp_path / "s.npy", ROUGH)
    return tmp_path


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("missing", ["hole", "fill"])
def test_filters_follow_crop_missing_points_and_level(saved, missing, periodic):
    how = {"level": "plane", "crop": (0, 100, 2, 72), "missing": missing}
    texts = {"surface_level": "plane", "surface_crop": "0,100,2,72", "surface_missing": missing}
    problem = made(
        saved / "s.h5",
        surface_s_filter="0.005",
        surface_l_filter="0.02",
        periodic=str(periodic).lower(),
        **texts,
    )
    filters = {"s_filter": 5e-3, "l_filter": 0.02, "periodic": periodic}
    surface = read_surface(saved / "s.h5", **how, **filters)
    np.testing.assert_array_equal(-problem.shape_on(problem.grid), surface.heights())
    np.testing.assert_array_equal(surface.heights(slice(3, 9)), surface.heights()[3:9])
    before = read_surface(saved / "s.h5", **how, periodic=periodic).heights()
    cell = tuple(1e-3 * side for side in CELL)
    np.testing.assert_allclose(surface.heights(), band_pass(before, 5e-3, 0.02, cell, periodic), atol=1e-15)
    facts = problem.describe()
    assert (facts["surface_s_filter"], facts["surface_l_filter"]) == (5e-3, 0.02)
    assert "S-filtered at 5 um, L-filtered at 20 um; about the best plane" in facts["surface_read"]
    assert surface.rms_level == pytest.approx(np.nanstd(surface.heights()), rel=1e-2)
    assert surface.rms_slope(problem.grid) < 0.2 * read_surface(saved / "s.h5", **how).rms_slope(problem.grid)


def test_filters_precede_averages_of_cells(saved):
    texts = {"surface_unit": "nm", "domain": "0,0.06,0,0.09", "surface_s_filter": "0.004"}
    fine, coarse = made(saved / "s.npy", **texts), made(saved / "s.npy", grid="60,36", **texts)
    blocks = fine.shape_on(fine.grid).reshape(36, 2, 60, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.shape_on(coarse.grid), blocks, atol=1e-18)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        ({"s_filter": "0"}, "-surface_s_filter 0: must be a positive number"),
        ({"s_filter": "0.02", "l_filter": "0.02"}, "s_filter 0.02 and l_filter 0.02: leave no waves between"),
        ({"s_filter": "0.0024"}, "s_filter 0.0024 mm: must be 0.0025 to 0.06 mm"),
    ],
)
def test_nesting_indices_out_of_range_are_refused(saved, filters, message):
    with pytest.raises(InputError, match=message):
        made(saved / "s.h5", **{f"surface_{name}": text for name, text in filters.items()})
    if "must be" not in message:
        with pytest.raises(InputError, match=message):
            read_surface(saved / "s.h5", **{name: float(text) for name, text in filters.items()})


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"l_filter": np.nan}, "l_filter nan: must be a positive wavelength"),
        ({"s_filter": "5 um"}, "s_filter '5 um': must be a positive wavelength"),
        ({"s_filter": 0.01}, "spacing= of read_surface is missing"),
        ({"s_filter": 0.01, "spacing": (1e-3, 1e-3), "crop": (3, 4, 5, 6)}, "one cell: nothing to filter"),
    ],
)
def test_wrong_filters_are_refused(how, message):
    with pytest.raises(InputError, match=message):
        read_surface(ROUGH, "nm", **how)


def test_filters_use_the_spacing_of_the_grid(saved):
    surface = read_surface(saved / "s.npy", "nm")
    grid = surface.grid((0, 0.06, 0, 0.09))
    filtered = surface.filtered(grid, s_filter=5e-3)
    known = read_surface(saved / "s.npy", "nm", spacing=(5e-4, 1.25e-3), s_filter=5e-3)
    np.testing.assert_allclose(filtered.heights(), known.heights(), atol=1e-15)
    assert surface.s_filter is None and surface.filtered(grid) is surface
    with pytest.raises(InputError, match="filtered already"):
        filtered.filtered(grid, l_filter=0.02)
    ContactProblem(grid, Material.from_contact_modulus(1.0), surfaces=[filtered])


@pytest.mark.parametrize("periodic", [False, True])
def test_a_surface_and_its_problem_are_both_periodic_or_neither(saved, periodic):
    """Filters that went around took heights of one side off the other one; a periodic symbol is the problem's own."""
    steel, how = Material.from_contact_modulus(1.0), {"level": "plane", "periodic": periodic}
    plain = read_surface(saved / "s.h5", **how)
    surface = read_surface(saved / "s.h5", **how, l_filter=0.03)
    assert bool(surface.grid().periodic) is bool(plain.grid().periodic) is periodic
    assert "L-filtered at 30 um" in str(surface)
    kinds = ("free", "periodic")[:: -1 if periodic else 1]
    message = f"read for a {kinds[0]} patch, this one is {kinds[1]}; must be the same periodic="
    with pytest.raises(InputError, match=message):
        ContactProblem(read_surface(saved / "s.h5").grid(periodic=not periodic), steel, surfaces=[surface])
    for right in (plain, surface):
        ContactProblem(right.grid(), steel, surfaces=[right], periodic="love" if periodic else False)
    if not periodic:  # not stated
        ContactProblem(plain.grid(), steel, surfaces=[plain], periodic=True)
