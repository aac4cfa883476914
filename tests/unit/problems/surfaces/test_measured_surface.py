"""Measured surfaces: averages, grids, texts, notes on units and spikes."""

import numpy as np
import pytest

from app import InputError, read_surface
from app.base.units import format_lengths

from ..from_options import problem_from
from .maps import DX, HEIGHTS, NX, NY, X


def made(path, **texts):
    return problem_from(problem="rough", surface_file=path, **texts)


def test_filled_points_are_counted_in_notes_and_facts(saved):
    holes = np.random.default_rng(2).random((NY, NX)) < 0.3
    filled = read_surface(saved(np.where(holes, np.nan, HEIGHTS)), "mm", missing="fill")
    assert filled.missing_points == filled.describe()["surface_missing_points"] == holes.sum()
    assert f"{holes.sum()} of {holes.size} points were missing and are filled" in filled.notes[0]
    assert f", {holes.sum()} of {holes.size} points filled; about" in filled.understood(
        filled.grid((0, 1, 0, 1))
    )
    np.testing.assert_array_equal(filled.heights(slice(4, 7)), filled.heights()[4:7])


def test_coarser_grid_takes_means_of_whole_blocks(saved):
    path = saved(HEIGHTS, "s.h5")
    problem = made(path, grid="5,6")
    expected = 1e-3 * HEIGHTS.reshape(6, 2, 5, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(-problem.shape_on(problem.grid), expected, rtol=1e-12)
    np.testing.assert_array_equal(
        problem.shape_on(problem.grid, slice(2, 5)), problem.shape_on(problem.grid)[2:5]
    )
    assert problem.grid.dx * 5 == pytest.approx(1e-3 * DX * NX) and "averaged" in problem.notes[0]
    with pytest.raises(InputError, match=r"has 15 x 12 cells; must be -grid 15,12 or whole fractions"):
        made(path, grid="6,6")
    with pytest.raises(InputError, match="grid 0,0: surface file"):
        read_surface(HEIGHTS, "mm").averaged((0, 0))


def test_heights_of_both_bodies_are_subtracted(saved, tmp_path):
    np.save(tmp_path / "other.npy", HEIGHTS[::-1] ** 2)
    path = saved(HEIGHTS, "s.h5")
    problem = made(path, surface_file2=str(tmp_path / "other.npy"), surface_unit="um")
    np.testing.assert_allclose(
        problem.shape_on(problem.grid), -1e-3 * (HEIGHTS + HEIGHTS[::-1] ** 2), rtol=1e-12
    )
    facts = problem.describe()
    assert facts["surface_file"].endswith("s.h5") and facts["surface_file2"].endswith("other.npy")
    np.save(tmp_path / "other.npy", HEIGHTS[:, 1:])
    with pytest.raises(InputError, match=r"other.npy: has 14 x 12 cells, the grid 15 x 12"):
        made(path, surface_file2=str(tmp_path / "other.npy"), surface_unit="um")


def test_a_surface_is_printed_as_it_was_understood(saved):
    path = saved(HEIGHTS, "s.h5")
    text = str(read_surface(path))
    assert text.startswith(
        f"surface file {path}: 15 x 12 heights in um, cells of 0.4 x 0.5 um, patch of 6 x 6 um"
    )
    heights = HEIGHTS + 100 * X
    surface = read_surface(heights, "um")
    rms = f"rms height about the best plane {format_lengths(surface.rms_level)}"
    assert (
        repr(surface)
        == f"<Surface (array): 15 x 12 heights in um, {rms}, in cells of a size it does not say>"
    )
    assert repr(read_surface(path)) == f"<Surface {text.removeprefix('surface file ')}>"


def test_a_surface_of_known_spacing_needs_no_grid(saved):
    surface = read_surface(saved(HEIGHTS, "s.h5")).averaged((6, 5))
    assert surface.rms_slope() == surface.rms_slope(surface.grid())
    assert surface.understood() == surface.understood(surface.grid())
    with pytest.raises(InputError, match="does not say its spacing"):
        read_surface(HEIGHTS, "um").rms_slope()
