"""Height maps: units, spacing, orientation, coordinates, ESRI grids."""

import re

import h5py
import numpy as np
import pytest

from app import InputError, read_surface
from app.base.units import UNITS
from app.cli.convert import main as convert

from .maps import DX, DY, FORMATS, HEIGHTS, TOLD


def test_units_are_converted_to_mm(saved):
    for unit, scale in (UNITS | {"Å": 1e-7, "\u212b": 1e-7, "µm": 1e-3}).items():
        np.testing.assert_allclose(read_surface(saved(HEIGHTS), unit).heights(), scale * HEIGHTS, rtol=1e-15)


def test_a_second_spacing_is_refused(saved):
    assert read_surface(saved(HEIGHTS), "um", spacing=(0.1, 0.2)).grid().dy == pytest.approx(0.2)
    with pytest.raises(InputError, match="spacing=: surface file .*s.h5 says 400 x 500 nm itself"):
        read_surface(saved(HEIGHTS, "s.h5"), spacing=(0.1, 0.2))


def test_heights_may_have_another_unit_than_points(saved):
    points = saved(HEIGHTS, "s.xyz")
    surface = read_surface(points, "mm", height_unit="um")
    np.testing.assert_allclose(surface.heights(), 1e-3 * HEIGHTS, rtol=1e-15)
    assert surface.spacing == pytest.approx((DX, DY))
    np.testing.assert_array_equal(read_surface(saved(HEIGHTS), height_unit="um").heights(), surface.heights())
    with pytest.raises(
        InputError, match=r"-surface_unit\) is missing: .* does not say the unit of its x and y"
    ):
        read_surface(points, height_unit="um")
    with pytest.raises(InputError, match=r"-surface_height_unit\) nm: surface file .* says um"):
        read_surface(saved(HEIGHTS, "s.h5"), height_unit="nm")


TURNED = {
    (): HEIGHTS,
    ("transpose",): HEIGHTS.T,
    ("flip_x",): HEIGHTS[:, ::-1],
    ("flip_y",): HEIGHTS[::-1],
    ("transpose", "flip_y"): HEIGHTS.T[::-1],
    ("flip_y", "transpose"): HEIGHTS[::-1].T,
    ("transpose", "flip_x", "transpose"): HEIGHTS[::-1],
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("orient", TURNED)
def test_orientation_turns_rows_columns_and_spacing(saved, name, orient):
    """Orientation is a sequence or a text."""
    assert read_surface(HEIGHTS, "um", orient=",".join(orient) or None).orient == orient
    surface = read_surface(saved(HEIGHTS, name), None if name in TOLD else "um", orient=orient)
    np.testing.assert_allclose(surface.heights(), 1e-3 * TURNED[orient], rtol=1e-15)
    if surface.spacing:
        turned = orient.count("transpose") % 2
        assert surface.spacing == pytest.approx((1e-3 * DY, 1e-3 * DX) if turned else (1e-3 * DX, 1e-3 * DY))


def test_a_part_of_a_map_with_more_cells_than_petsc_can_number(tmp_path):
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("heights", (60_000, 60_000), "f4", chunks=(1000, 1000))
    surface = read_surface(tmp_path / "large.h5", "um", crop=(50_000, 50_015, 40_000, 40_012))
    assert surface.shape == (12, 15) and not surface.heights().any()


UNEVEN = np.random.default_rng(5).standard_normal((20, 30)).cumsum(axis=0).cumsum(axis=1)
ALONG, UP = np.arange(30) / 3, np.arange(20)[:, None] / 7


@pytest.mark.parametrize("tilt", [0, 3, 1000])
@pytest.mark.parametrize("head", ["row", "column", "row and column"])
def test_coordinates_at_the_rim_are_refused(tmp_path, head, tilt):
    column, row = (int(what in head) for what in ("column", "row"))
    heights = UNEVEN + tilt * (7 * ALONG - 5 * UP)
    table = np.hstack([UP, heights]) if column else heights
    table = np.vstack([np.append(np.zeros(column), ALONG), table]) if row else table
    np.savetxt(path := tmp_path / "s.txt", table, fmt="%.6g")
    ny, nx = table.shape
    with pytest.raises(
        InputError, match=f"first {head}: equal steps, .*-surface_crop {column},{nx},{row},{ny},"
    ):
        read_surface(path, "um")
    converted = [str(path), "-o", str(tmp_path / "s.h5"), "--unit", "um", "--spacing", "1,2"]
    assert convert(converted) == 2
    assert convert([*converted, "--crop", f"{column},{nx},{row},{ny}"]) == 0
    left = read_surface(path, "um", crop=(column, nx, row, ny)).heights()
    np.testing.assert_allclose(left, 1e-3 * heights, rtol=1e-5)
    surface = read_surface(tmp_path / "s.h5")
    np.testing.assert_array_equal(surface.heights(), left)
    assert surface.spacing == (1, 2)
    assert read_surface(path, "um", crop=(0, nx, 0, ny)).shape == table.shape


@pytest.mark.parametrize("seed", range(4))
def test_coordinates_beside_smooth_heights_are_refused(tmp_path, seed):
    """The steps of the second row may be much smaller than those of the third one."""
    heights = np.random.default_rng(seed).normal(size=(20, 30)).cumsum(axis=0).cumsum(axis=1)
    heights[0] *= 0.2
    np.savetxt(path := tmp_path / "s.txt", np.vstack([ALONG, heights]), fmt="%.6g")
    with pytest.raises(InputError, match="first row: equal steps"):
        read_surface(path, "um")


@pytest.mark.parametrize("head", ["row", "column"])
def test_coordinates_beside_missing_points_are_refused(tmp_path, head):
    heights = UNEVEN.copy()
    heights[[2, 5], [0, 1]] = heights[0, 4] = np.nan  # in both rows and both columns at the rim
    heights[:, 2] = heights[1] = np.nan
    table = np.hstack([UP, heights]) if head == "column" else np.vstack([ALONG, heights])
    np.savetxt(path := tmp_path / "s.txt", table, fmt="%.9g")
    with pytest.raises(InputError, match=f"first {head}: equal steps"):
        read_surface(path, "um")
    np.savetxt(path, heights, fmt="%.9g")
    assert read_surface(path, "um").shape == heights.shape


@pytest.mark.parametrize("orient", ["flip_x", "flip_y", "transpose,flip_y"])
def test_coordinates_are_refused_at_any_side(tmp_path, orient):
    table = np.vstack([np.append(0, ALONG), np.hstack([UP, UNEVEN])])
    np.savetxt(path := tmp_path / "s.txt", table, fmt="%.9g")
    with pytest.raises(InputError, match="first row and column: equal steps") as refused:
        read_surface(path, "um", orient=orient)
    crop = re.search(r"-surface_crop ([\d,]+),", str(refused.value))[1]
    left = read_surface(path, "um", orient=orient, crop=[*map(int, crop.split(","))])
    np.testing.assert_allclose(left.heights(), read_surface(UNEVEN, "um", orient=orient).heights(), rtol=1e-6)


MAPS = {
    "plane": ALONG + UP,
    "rough": UNEVEN,
    "tilted": UNEVEN + 100 * UP,
    "tilted along rows": UNEVEN + 1000 * ALONG,
    "twisted": ALONG * UP + ALONG,
    "cylinder": (ALONG - 5) ** 2 + UP,
    "cap on a plane": np.maximum(0, 9 - (ALONG - 5) ** 2 - (UP - 1) ** 2) + UP,
    "tapered to a plane": UP + 1e-2 * UNEVEN * np.outer(np.hanning(20), np.hanning(30)),
}


@pytest.mark.parametrize("heights", MAPS.values(), ids=MAPS)
def test_heights_are_not_taken_for_coordinates(tmp_path, heights):
    np.savetxt(path := tmp_path / "s.txt", heights, fmt="%.4g")
    assert read_surface(path, "um").shape == heights.shape


ESRI = "ncols 15\nNROWS 12\nxllcorner 0\nyllcorner 0\n{}\nNODATA_value -9999\n"


@pytest.mark.parametrize(
    ("cells", "sides"),
    [("cellsize 0.4", (0.4, 0.4)), ("DX 0,4\ndy 0.5", (0.4, 0.5)), ("cellsize wide", None)],
)
def test_the_head_of_an_esri_grid_states_its_cells(tmp_path, cells, sides):
    head = ESRI.format(cells)
    np.savetxt(path := tmp_path / "s.asc", HEIGHTS[::-1], fmt="%.9f", header=head, comments="")
    how = {"skip": head.count("\n") + 1, "orient": "flip_y"}
    if sides is None:
        with pytest.raises(InputError, match="s.asc: spacing .*wide.* must be two positive numbers"):
            read_surface(path, "um", **how)
        return
    surface = read_surface(path, "um", **how)
    assert surface.spacing == pytest.approx([1e-3 * side for side in sides])
    np.testing.assert_allclose(surface.heights(), 1e-3 * HEIGHTS, atol=1e-12)
    (led := tmp_path / "led.asc").write_text("\n# by hand\n" + path.read_text())
    for file, skip in (path, 0), (path, how["skip"]), (led, 0), (led, how["skip"] + 2):
        bare = read_surface(file, "um", skip=skip)  # the head and the way of the rows are known
        assert bare.spacing == surface.spacing and bare.orient == surface.orient == ("flip_y",)
        np.testing.assert_array_equal(bare.heights(), surface.heights())
    as_written = read_surface(path, "um", orient="flip_y,flip_y").heights()
    np.testing.assert_array_equal(as_written, surface.heights()[::-1])
    other = read_surface(path, "mm", height_unit="um", **how)
    np.testing.assert_array_equal(other.heights(), surface.heights())
    assert other.spacing == pytest.approx(sides)
    with pytest.raises(
        InputError, match=f"unit of its heights, nor of its cells of 0.4 x {sides[1]}; it must be"
    ):
        read_surface(path, **how)
    for more in ("--skip", how["skip"], "--orient", "flip_y"), ():
        words = [path, "-o", tmp_path / "s.h5", "--unit", "mm", "--height-unit", "um", *more]
        assert convert([*map(str, words)]) == 0
        assert read_surface(tmp_path / "s.h5").spacing == pytest.approx(sides)
        np.testing.assert_allclose(read_surface(tmp_path / "s.h5").heights(), surface.heights(), rtol=1e-12)


@pytest.mark.parametrize(("shape", "what"), [((24, 10), "24 lines of 10"), ((4, 15), "4 lines of 15")])
def test_an_esri_grid_whose_lines_are_no_rows_is_refused(tmp_path, shape, what):
    heights = np.resize(HEIGHTS, shape)
    head = ESRI.format("cellsize 1")
    np.savetxt(path := tmp_path / "s.asc", heights, header=head, comments="")
    for skip in (0, head.count("\n") + 1):
        with pytest.raises(
            InputError, match=f"nrows 12, ncols 15; there are {what} numbers; each line must be a row"
        ):
            read_surface(path, "um", skip=skip)
