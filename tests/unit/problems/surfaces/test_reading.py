"""Reading of surfaces: formats, units, crop, level, missing points, notes."""

import copy
import pickle
import re

import numpy as np
import pytest

from app import ContactProblem, InputError, Material, Sphere, read_surface
from app.problems.gap_file import GapFile

from ..from_options import problem_from
from .maps import DX, DY, FORMATS, HEIGHTS, TOLD, X, Y


def made(path, **texts):
    return problem_from(problem="rough", surface_file=path, **texts)


def test_an_array_is_read_like_a_file(saved):
    heights = np.where(HEIGHTS > 1, np.nan, HEIGHTS)
    masked = np.ma.masked_greater(HEIGHTS, 1)
    how = {"unit": "um", "level": "plane", "crop": (1, 8, 2, 9), "orient": ("transpose",)}
    file = read_surface(saved(heights), **how)
    for source in (heights, masked, heights.tolist()):
        surface = read_surface(source, **how, spacing=(DX, DY))
        np.testing.assert_array_equal(surface.heights(), file.heights())
        assert surface.missing_points == file.missing_points > 0
        assert surface.notes[0] == file.notes[0].replace(file.file, "(array)")
        assert surface.grid().dx == pytest.approx(DY)  # turned, too
    assert not np.isnan(read_surface(heights, "um", missing="fill").heights()).any()
    grid, steel = surface.grid(), Material.from_contact_modulus(1e5)
    assert ContactProblem(grid, steel, surfaces=[surface]).describe()["surface_file"] == "(array)"


@pytest.mark.parametrize(
    ("source", "how", "message"),
    [
        (HEIGHTS[0], {}, r"shape \(15,\); must be real numbers of shape \(ny, nx\)"),
        (None, {}, "a file name, or an array of real numbers"),
        (HEIGHTS, {"unit": None}, r"^unit= \(-surface_unit\) is missing"),
        (HEIGHTS, {"unit": "micron"}, "surface unit micron: must be one of m, cm, mm, um, nm, pm, angstrom, in"),
        (HEIGHTS, {"spacing": (0.1,)}, "two positive numbers dx, dy"),
        (HEIGHTS, {"crop": (0, 3, 0)}, "four whole numbers i0, i1, j0, j1"),
        (HEIGHTS, {"skip": -1}, "surface skip -1: .* a number of lines"),
        (HEIGHTS, {"orient": "flip_z"}, "surface orient flip_z: must be one of"),
        (HEIGHTS, {"periodic": "no"}, "periodic: 'no'"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_refused(source, how, message):
    with pytest.raises(InputError, match=message):
        read_surface(source, **{"unit": "um", **how})


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_heights_and_holes(saved, name):
    heights = HEIGHTS.copy()
    heights[3, 4:6], heights[10, 0] = np.nan, np.nan
    path = saved(heights, name)
    surface = read_surface(path, unit=None if name in TOLD else "µm")
    np.testing.assert_allclose(surface.heights(), 1e-3 * heights, rtol=1e-15)
    np.testing.assert_array_equal(surface.heights(slice(3, 5)), surface.heights()[3:5])
    assert surface.missing_points == 3 and len(surface.notes) == 1
    domain = None if surface.spacing else (-0.003, 0.003, -0.003, 0.003)
    grid = surface.grid(domain)
    assert (grid.dx, grid.dy) == pytest.approx((1e-3 * DX, 1e-3 * DY), rel=1e-8)
    assert (grid.x0, grid.y0) == pytest.approx((-0.003, -0.003), rel=1e-8)  # about the origin
    problem = ContactProblem(grid, Material.combined(1.0, 0.3), Sphere(1.0), surfaces=[surface])
    smooth = ContactProblem(grid, Material.combined(1.0, 0.3), Sphere(1.0))
    np.testing.assert_allclose(problem.shape_on(grid), smooth.shape_on(grid) - 1e-3 * heights, rtol=1e-12)


@pytest.mark.parametrize(("level", "terms"), [("mean", 1), ("plane", 3), ("quadratic", 6)])
def test_level_subtracts_its_polynomial_and_nothing_else(saved, level, terms):
    """Least squares: what is left is orthogonal to it, and what was added makes no difference."""
    x, y = np.broadcast_arrays(X / X.max(), Y / Y.max())
    basis = np.stack([x**0, x, y, x * y, x**2, y**2])[[0, 1, 2, 3, 4, 5][:terms]]
    heights = HEIGHTS.copy()
    heights[2:5, 7:9] = np.nan
    known = ~np.isnan(heights)
    bent = heights + 1e3 * np.tensordot(np.arange(1, terms + 1), basis, 1)
    left = read_surface(saved(bent), "mm", level).heights()
    np.testing.assert_allclose(left, read_surface(saved(heights), "mm", level).heights(), atol=1e-9)
    assert np.abs((basis * np.where(known, left, 0)).sum(axis=(1, 2))).max() < 1e-8


def test_large_offsets_cost_no_digits(saved):
    flat = read_surface(saved(1e6 + 1e-3 * HEIGHTS), "um", "plane").heights()
    expected = read_surface(saved(1e-3 * HEIGHTS), "um", "plane").heights()
    np.testing.assert_allclose(flat, expected, atol=1e-12)


def test_level_is_fitted_to_the_crop(saved):
    whole = read_surface(saved(HEIGHTS), "um", "plane", crop=(2, 12, 1, 9))
    np.save(path := saved(HEIGHTS).replace("s.npy", "part.npy"), HEIGHTS[1:9, 2:12])
    np.testing.assert_array_equal(whole.heights(), read_surface(path, "um", "plane").heights())
    assert whole.shape == (8, 10) and whole.crop == (2, 12, 1, 9)


def test_crop_follows_the_turns(saved):
    turned = read_surface(saved(HEIGHTS), "um", crop=(1, 4, 2, 10), orient=("transpose",))
    np.testing.assert_allclose(turned.heights(), 1e-3 * HEIGHTS.T[2:10, 1:4], rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "texts", "message"),
    [
        ("s.npy", {}, r"-surface_unit\) is missing: .*s.npy does not say the unit .* m, cm, mm, um, nm"),
        ("s.npy", {"surface_unit": "inch"}, "-surface_unit inch: must be one of m, cm, mm, .*µm is um, Å is"),
        ("s.npy", {"surface_unit": "um"}, r"-domain\) is missing: surface file .* does not say its spacing"),
        ("s.h5", {"surface_unit": "nm"}, r"-surface_unit\) nm: surface file .* says um"),
        ("s.h5", {"domain": "0,1,0,1"}, r"its patch is 0.006 x 0.006 mm; the domain is 1 x 1 mm"),
        ("s.h5", {"surface_level": "cubic"}, "-surface_level cubic: must be"),
        ("s.h5", {"surface_crop": "0,16,0,2"}, "surface crop 0,16,0,2: .* columns 0,15 and rows 0,12"),
        ("s.h5", {"surface_missing": "zero"}, "-surface_missing zero: must be"),
        ("none.npy", {}, "surface file .*none.npy: no such file"),
    ],
)
def test_wrong_options_of_measured_surfaces_are_refused(saved, tmp_path, name, texts, message):
    path = saved(HEIGHTS, name) if name in FORMATS else str(tmp_path / name)
    with pytest.raises(InputError, match=message):
        made(path, **texts)


@pytest.mark.parametrize(
    ("value", "message"), [(np.inf, "inf mm in row 0, column 0"), (np.nan, "all points are missing")]
)
def test_infinite_or_only_missing_heights_are_refused(saved, value, message):
    with pytest.raises(InputError, match=re.escape(message)):
        read_surface(saved(np.full((4, 4), value)), "um")


def test_a_tilt_is_noted(saved):
    assert read_surface(saved(HEIGHTS), "um").notes == ()
    assert "tilted by" in read_surface(saved(HEIGHTS + 100 * X), "um").notes[0]
    assert read_surface(saved(HEIGHTS + 100 * X), "um", "plane").notes == ()


SHAPED = np.random.default_rng(6).normal(size=(48, 64))


@pytest.mark.parametrize("tilt", [0, 0.02])
@pytest.mark.parametrize(
    ("lines", "named"),
    [
        (np.s_[:1], "row 0 "),
        (np.s_[-3:], "rows 45, 46, 47 "),
        (np.s_[:, 63:], "column 63 "),
        (np.s_[:, :9], "columns 0, 1, 2, 3, ... "),
        (np.s_[20:21], "row 20 "),
    ],
)
def test_rows_that_were_never_measured_are_noted(lines, named, tilt):
    """They all have the lowest height, and move the best plane."""
    heights = 40 + SHAPED + tilt * np.arange(64)
    assert read_surface(heights, "um").notes == ()
    heights[lines] = 0.0
    heights[5, 10] = np.nan
    note = next(note for note in read_surface(heights, "um").notes if "not measured" in note)
    assert f"all points in {named}have the lowest height" in note


@pytest.mark.parametrize(
    "heights",
    [
        SHAPED,
        np.maximum(SHAPED, -1),
        np.maximum(0, 1 - np.hypot(*np.meshgrid(np.linspace(-2, 2, 64), np.linspace(-2, 2, 48)))),
        -(np.linspace(-1, 1, 64) ** 2) + np.zeros((48, 1)),
        SHAPED[:1] + np.zeros((48, 1)),
        np.abs(SHAPED) * np.outer(np.hanning(48), np.hanning(64)),
        np.pad(np.ones((20, 30)), 10),
        np.where(SHAPED > 0, 3.0, np.nan),
    ],
    ids=["rough", "cut off", "cone on a plane", "cylinder", "grooves", "tapered", "mesa", "constant"],
)
def test_lowest_rows_of_a_surface_are_not_noted(heights):
    assert not any("not measured" in note for note in read_surface(heights, "um").notes)


def test_problems_of_files_can_be_pickled(saved):
    for name, spacing, dataset in ("s.npy", (0.1, 0.1), ""), ("s.h5", None, ":/heights"):
        path = saved(HEIGHTS, name)
        for orient in (), ("transpose",):
            surface = read_surface(path, "um", orient=orient, spacing=spacing)
            problem = ContactProblem(surface.grid(), Material.combined(1.0, 0.3), surfaces=[surface])
            for same in (pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):
                np.testing.assert_array_equal(same.shape_on(same.grid), problem.shape_on(problem.grid))
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(GapFile(path + dataset))).rows(), HEIGHTS)
