"""Points x, y, z on a lattice, and line scans."""

import numpy as np
import pytest

from app import InputError, read_surface
from app.cli.convert import main as convert
from app.problems.surfaces.points import POINTS, arrange, detect_list

from .maps import DX, HEIGHTS, X, Y

TABLE = np.stack(np.broadcast_arrays(X, Y, HEIGHTS), -1).reshape(-1, 3)


@pytest.mark.parametrize("columns", [slice(None), [0, 1, 2, 3, 9, 10, 14, 15]])
def test_points_may_miss_their_places_by_part_of_a_cell(columns):
    x, y = np.meshgrid(2.0 * np.arange(16)[columns], 3.0 * np.arange(20))
    points = np.stack([x, y, 10 * y + x], -1).reshape(-1, 3)
    exact, spacing = arrange(points)
    points[:, :2] += np.random.default_rng(2).uniform(-1, 1, (len(points), 2)) * (0.14, 0.21)
    heights, near = arrange(points)
    np.testing.assert_array_equal(heights, exact)
    assert spacing == (2, 3) and near == pytest.approx(spacing, rel=5e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.random.default_rng(1).random((40, 3)), "no points x, y, z of a grid"),
        (np.vstack([TABLE, TABLE[:1]]), "two points lie in the same place"),
        (TABLE[::9], "scattered points"),
        (TABLE[:12], "all points have the same y"),
        (np.where(np.arange(3) == 0, TABLE + 0.3 * DX * (np.arange(180)[:, None] == 77), TABLE), "off the spacing"),
        (np.where(np.arange(540).reshape(180, 3) == 9, np.nan, TABLE), "must be numbers"),
    ],
)  # fmt: skip
def test_points_off_a_grid_are_refused(tmp_path, points, message):
    np.savetxt(tmp_path / "s.txt", points, fmt="%.9f")
    with pytest.raises(InputError, match=message):
        read_surface(tmp_path / "s.txt", "um")


@pytest.mark.parametrize("shape", [(2, 2), (3, 2), (2, 3), (3, 3), (4, 3)])
def test_few_points_of_a_whole_lattice_are_points(shape, tmp_path):
    heights = np.random.default_rng(5).normal(size=shape)
    y, x = np.mgrid[: shape[0], : shape[1]]
    points = np.random.default_rng(6).permutation(np.stack([x, 0.5 * y, heights], -1).reshape(-1, 3))
    np.savetxt(tmp_path / "few.txt", points)
    surface = read_surface(tmp_path / "few.txt", "mm")
    assert surface.shape == shape and surface.spacing == pytest.approx((1.0, 0.5))


SCAN, RANDOM = np.arange(40) / 7, np.random.default_rng(1)


def test_a_line_scan_is_kept_as_a_map_by_crop_only(tmp_path):
    np.savetxt(path := tmp_path / "s.txt", np.stack([SCAN, np.cos(SCAN)], -1))
    with pytest.raises(InputError, match="40 lines of 2 numbers are x, z of a line scan, not a map"):
        read_surface(path, "um")
    command = [str(path), "-o", str(tmp_path / "s.h5"), "--unit", "um", "--spacing", "1,1"]
    assert convert(command) == 2
    assert convert([*command, "--crop", "0,2,0,40"]) == 0
    assert read_surface(path, "um", crop=(0, 2, 0, 40)).shape == (40, 2)


@pytest.mark.parametrize("z", [np.cos, np.square, np.ones_like])
@pytest.mark.parametrize("x", [SCAN, SCAN[::-1], SCAN**2, SCAN[:5] ** 2, RANDOM.permutation(SCAN)])
def test_line_scans_are_detected(x, z):
    """Steps may be equal or not, places sorted or not."""
    assert detect_list(np.stack([x, z(x)], -1)) == "x, z of a line scan"


def test_lists_and_maps_are_told_apart():
    scan, x, y = np.stack([SCAN, np.cos(SCAN)]), *np.meshgrid(2.0 * np.arange(9), 3.0 * np.arange(6))
    points = np.stack([x, y, np.sin(x * y), 0 * x + 255], -1).reshape(-1, 4)
    assert detect_list(scan) == "x, z of a line scan"
    assert detect_list(np.zeros((10, 3))) == detect_list(points[:, :3]) == POINTS
    assert detect_list(points) == "points x, y, z with more behind z"
    for table in (
        np.cos([SCAN, SCAN + 1]),
        [SCAN, SCAN],
        RANDOM.normal(size=(6, 3)),
        RANDOM.normal(size=(40, 4)),
    ):
        assert detect_list(np.asarray(table)) == ""
