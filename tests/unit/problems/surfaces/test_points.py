"""Points x, y, z on a lattice, and line scans."""

import numpy as np
import pytest

from app import read_surface
from app.base.errors import InputError
from app.cli.convert import main as convert
from app.problems.gap_file import GapFile
from app.problems.surfaces.points import arrange

from .maps import DX, HEIGHTS, X, Y

POINTS = np.stack(np.broadcast_arrays(X, Y, HEIGHTS), -1).reshape(-1, 3)


@pytest.mark.parametrize("columns", [slice(None), [0, 1, 2, 3, 9, 10, 14, 15]])
def test_points_may_miss_their_places_by_part_of_a_cell(columns):
    """As stages and encoders do; also where lines of the grid are left out."""
    x, y = np.meshgrid(2.0 * np.arange(16)[columns], 3.0 * np.arange(20))
    points = np.stack([x, y, 10 * y + x], -1).reshape(-1, 3)
    exact, spacing = arrange(points)
    points[:, :2] += np.random.default_rng(2).uniform(-1, 1, (len(points), 2)) * (0.14, 0.21)
    found, about = arrange(points)
    np.testing.assert_array_equal(found, exact)
    assert spacing == (2, 3) and about == pytest.approx(spacing, rel=5e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.random.default_rng(1).random((40, 3)), "no points x, y, z of a grid"),
        (np.vstack([POINTS, POINTS[:1]]), "two points lie in the same place"),
        (POINTS[::9], "scattered points"),
        (POINTS[:12], "all points have the same y"),
        (np.where(np.arange(3) == 0, POINTS + 0.3 * DX * (np.arange(180)[:, None] == 77), POINTS), "off the spacing"),
        (np.where(np.arange(540).reshape(180, 3) == 9, np.nan, POINTS), "must be numbers"),
    ],
)  # fmt: skip
def test_points_that_are_no_grid(tmp_path, points, message):
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
    np.savetxt(tmp_path / "map.txt", np.random.default_rng(7).normal(size=(6, 3)))
    assert read_surface(tmp_path / "map.txt", "mm").shape == (6, 3)


SCAN = np.arange(40) / 7


@pytest.mark.parametrize(
    "x", [SCAN, SCAN[::-1], SCAN**2, SCAN[:5] ** 2, np.random.default_rng(1).permutation(SCAN)]
)
@pytest.mark.parametrize("z", [np.cos, np.square, np.ones_like])
def test_a_line_scan_is_no_map(tmp_path, x, z):
    """Equal steps or not, sorted or not; it is kept as a map of two columns only where that is said."""
    np.savetxt(path := tmp_path / "s.txt", np.stack([x, z(x)], -1), fmt="%.9g")
    with pytest.raises(InputError, match=f"{len(x)} lines of 2 numbers are x, z of a line scan, not a map"):
        read_surface(path, "um")
    words = [str(path), "-o", str(tmp_path / "s.h5"), "--unit", "um", "--spacing", "1,1"]
    assert convert(words) == 2
    assert convert([*words, "--crop", f"0,2,0,{len(x)}"]) == 0
    assert read_surface(path, "um", crop=(0, 2, 0, len(x))).shape == (len(x), 2)


def test_points_with_more_than_heights_are_no_map(tmp_path):
    x, y = np.meshgrid(2.0 * np.arange(9), 3.0 * np.arange(6))
    np.savetxt(
        path := tmp_path / "s.txt",
        np.stack([x, y, np.sin(x * y), 0 * x + 255], -1).reshape(-1, 4),
        fmt="%.6f",
    )
    for read in (lambda: read_surface(path, "um")), (lambda: GapFile(path)):
        with pytest.raises(
            InputError, match="54 lines of 4 numbers are points x, y, z with more behind z, not a map"
        ):
            read()


def test_a_line_scan_in_two_rows_is_no_map(tmp_path):
    np.savetxt(path := tmp_path / "s.txt", [SCAN, np.cos(SCAN)])
    with pytest.raises(InputError, match="2 lines of 40 numbers are x, z of a line scan"):
        read_surface(path, "um")
    np.savetxt(path, np.cos([SCAN, SCAN + 1]))
    assert read_surface(path, "um").shape == (2, 40)
