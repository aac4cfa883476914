"""Measured surfaces: the same heights from every format, levelled, cropped, filled, averaged; and what is refused."""

import re

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, Material, Sphere, read_surface, solve
from app.api.notes import note_doubtful_units, note_spike
from app.base.errors import InputError
from app.base.units import format_lengths
from app.cli.convert import main as convert
from app.cli.problem_options import PROBLEM_OPTIONS, make_problem
from app.options.option_table import OptionReader
from app.problems.surfaces import moments
from app.problems.surfaces.points import arrange

NY, NX = 12, 15
DX, DY = 0.4, 0.5  # um
X, Y = DX * (np.arange(NX) + 0.5), DY * (np.arange(NY) + 0.5)[:, None]
HEIGHTS = np.random.default_rng(5).normal(size=(NY, NX))  # um
PERIOD = "0,0.006,0,0.006"


def save_text(path, heights):
    np.savetxt(path, heights, fmt="%.17g", delimiter=";")


def save_points(path, heights):
    """In no order; missing points are left out."""
    points = np.stack(np.broadcast_arrays(7 + X, Y - 3, heights), -1).reshape(-1, 3)
    points = points[~np.isnan(points[:, 2])]
    np.savetxt(path, np.random.default_rng(1).permutation(points), fmt="%.9f %.9f %.17g")


def save_converted(path, heights):
    with h5py.File(path, "w") as file:
        file["heights"], file["mask"] = heights, np.isnan(heights)
        file["heights"].attrs.update(unit="um", spacing=(1e3 * DX, 1e3 * DY), spacing_unit="nm")


def save_gwyddion(path, heights):
    """As its ASCII export is; in a micro sign that is a Greek letter."""
    ny, nx = heights.shape
    sides = f"Width: {nx * DX:.1f} \u03bcm\nHeight: {1e3 * ny * DY:.1f} nm"
    np.savetxt(path, heights, "%.17g", "\t", header=f"Channel: Z\n{sides}\nValue units: µm", encoding="utf-8")


FORMATS = {
    "s.npy": np.save, "s.csv": save_text, "s.xyz": save_points, "s.h5": save_converted, "s.txt": save_gwyddion
}  # fmt: skip
TOLD = ("s.h5", "s.txt")  # with their units


@pytest.fixture
def saved(tmp_path):
    def save(heights, name="s.npy"):
        FORMATS[name](tmp_path / name, heights)
        return str(tmp_path / name)

    return save


def made(path, **texts):
    given = {"problem": "rough", "contact_modulus": "1", "surface_file": path, **texts}
    reader = OptionReader(PROBLEM_OPTIONS, given)
    return make_problem(reader, given, MPI.COMM_SELF)[0]


def test_an_array_is_read_as_its_file(saved):
    heights = np.where(HEIGHTS > 1, np.nan, HEIGHTS)
    masked = np.ma.masked_greater(HEIGHTS, 1)
    how = {"unit": "um", "level": "plane", "crop": (1, 8, 2, 9), "orient": ("transpose",)}
    file = read_surface(saved(heights), **how)
    for given in (heights, masked, heights.tolist()):
        surface = read_surface(given, **how, spacing=(DX, DY))
        np.testing.assert_array_equal(surface.heights(), file.heights())
        assert surface.missing_points == file.missing_points > 0
        assert surface.notes[0] == file.notes[0].replace(file.file, "(array)")
        assert surface.grid().dx == pytest.approx(DY)  # turned, too
    assert not np.isnan(read_surface(heights, "um", missing="fill").heights()).any()
    grid, steel = surface.grid(), Material.from_contact_modulus(1e5)
    assert ContactProblem(grid, steel, surfaces=[surface]).describe()["surface_file"] == "(array)"


@pytest.mark.parametrize(
    ("given", "how", "message"),
    [
        (HEIGHTS[0], {}, r"shape \(15,\); needed: real numbers of shape \(ny, nx\)"),
        (HEIGHTS + 1j, {}, "a file name, or an array of real numbers"),
        (None, {}, "a file name, or an array of real numbers"),
        (HEIGHTS, {"unit": None}, r"^unit= \(-surface_unit\) is missing"),
        (
            HEIGHTS,
            {"unit": "micron"},
            "surface unit micron: must be one of m, cm, mm, um, nm, pm, angstrom, in",
        ),
        (HEIGHTS, {"spacing": 0.1}, "two positive numbers dx, dy"),
        (HEIGHTS, {"spacing": (0.1, 0)}, "two positive numbers dx, dy"),
        (HEIGHTS, {"crop": (0, 3, 0)}, "four whole numbers i0, i1, j0, j1"),
        (HEIGHTS, {"crop": (0, 3, 0, 2.5)}, "four whole numbers i0, i1, j0, j1"),
        (HEIGHTS, {"crop": 3}, "four whole numbers i0, i1, j0, j1"),
        (HEIGHTS, {"skip": -1}, "surface skip -1: .* a number of lines"),
        (HEIGHTS, {"skip": "2"}, "surface skip '2': .* a number of lines"),
        (HEIGHTS, {"orient": "flip_z"}, "surface orient flip_z: must be one of"),
    ],
)
def test_arrays_of_no_use(given, how, message):
    with pytest.raises(InputError, match=message):
        read_surface(given, **{"unit": "um", **how})


def test_spacing_is_said_once(saved):
    assert read_surface(saved(HEIGHTS), "um", spacing=(0.1, 0.2)).grid().dy == pytest.approx(0.2)
    with pytest.raises(InputError, match="spacing=: surface file .*s.h5 says 400 x 500 nm itself"):
        read_surface(saved(HEIGHTS, "s.h5"), spacing=(0.1, 0.2))


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
def test_level_takes_off_its_polynomial_and_nothing_else(saved, level, terms):
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


def test_crop_comes_first(saved):
    whole = read_surface(saved(HEIGHTS), "um", "plane", crop=(2, 12, 1, 9))
    np.save(path := saved(HEIGHTS).replace("s.npy", "part.npy"), HEIGHTS[1:9, 2:12])
    np.testing.assert_array_equal(whole.heights(), read_surface(path, "um", "plane").heights())
    assert whole.shape == (8, 10) and whole.crop == (2, 12, 1, 9)


UNEVEN = np.random.default_rng(5).standard_normal((20, 30)).cumsum(axis=0).cumsum(axis=1)
ALONG, UP = np.arange(30) / 3, np.arange(20)[:, None] / 7


@pytest.mark.parametrize("tilt", [0, 3, 1000])
@pytest.mark.parametrize("head", ["row", "column", "row and column"])
def test_coordinates_at_the_rim_are_no_heights(tmp_path, head, tilt):
    """Nor where the heights beside them go by nearly equal steps, too."""
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
def test_coordinates_are_told_beside_smooth_heights(tmp_path, seed):
    """The steps of the second row may be much smaller than those of the third one."""
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=(20, 30)).cumsum(axis=0).cumsum(axis=1)
    heights[0] *= 0.2
    np.savetxt(path := tmp_path / "s.txt", np.vstack([ALONG, heights]), fmt="%.6g")
    with pytest.raises(InputError, match="first row: equal steps"):
        read_surface(path, "um")


@pytest.mark.parametrize("head", ["row", "column"])
def test_coordinates_are_told_beside_missing_points(tmp_path, head):
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
def test_coordinates_are_told_whatever_side_they_are_turned_to(tmp_path, orient):
    table = np.vstack([np.append(0, ALONG), np.hstack([UP, UNEVEN])])
    np.savetxt(path := tmp_path / "s.txt", table, fmt="%.9g")
    with pytest.raises(InputError, match="first row and column: equal steps") as refused:
        read_surface(path, "um", orient=orient)
    crop = re.search(r"-surface_crop ([\d,]+),", str(refused.value))[1]
    left = read_surface(path, "um", orient=orient, crop=[*map(int, crop.split(","))])
    np.testing.assert_allclose(left.heights(), read_surface(UNEVEN, "um", orient=orient).heights(), rtol=1e-6)


@pytest.mark.parametrize(
    "heights",
    [
        ALONG + UP,
        UNEVEN,
        UNEVEN + 100 * UP,
        UNEVEN + 1000 * ALONG,
        ALONG * UP + ALONG,
        (ALONG - 5) ** 2 + UP,
        np.maximum(0, 9 - (ALONG - 5) ** 2 - (UP - 1) ** 2) + UP,
        UP + 1e-2 * UNEVEN * np.outer(np.hanning(20), np.hanning(30)),
    ],
    ids=[
        "plane",
        "rough",
        "tilted",
        "tilted along rows",
        "twisted",
        "cylinder",
        "cap on a plane",
        "tapered to a plane",
    ],
)
def test_heights_are_no_coordinates(tmp_path, heights):
    np.savetxt(path := tmp_path / "s.txt", heights, fmt="%.4g")
    assert read_surface(path, "um").shape == heights.shape


def test_filled_points_are_harmonic(saved):
    plane = 3 + 2 * X - Y
    holes = np.random.default_rng(2).random((NY, NX)) < 0.3
    holes[[0, -1]] = holes[:, [0, -1]] = False
    filled = read_surface(saved(np.where(holes, np.nan, plane)), "mm", missing="fill")
    np.testing.assert_allclose(filled.heights(), plane, rtol=1e-12)
    assert filled.missing_points == holes.sum()
    assert f"{holes.sum()} of {holes.size} points were missing and are filled" in filled.notes[0]
    assert filled.describe()["surface_missing_points"] == holes.sum()
    grid = filled.grid((0, 1, 0, 1))
    assert f", {holes.sum()} of {holes.size} points filled; about" in filled.understood(grid)
    np.testing.assert_array_equal(filled.heights(slice(4, 7)), filled.heights()[4:7])
    rough = read_surface(saved(np.where(holes, np.nan, HEIGHTS)), "mm", missing="fill").heights()
    mean = (rough[:-2, 1:-1] + rough[2:, 1:-1] + rough[1:-1, :-2] + rough[1:-1, 2:]) / 4
    np.testing.assert_allclose(rough[1:-1, 1:-1][holes[1:-1, 1:-1]], mean[holes[1:-1, 1:-1]], atol=1e-12)
    np.testing.assert_array_equal(rough[~holes], HEIGHTS[~holes])


def test_coarser_grid_takes_means_of_whole_blocks(saved):
    path = saved(HEIGHTS, "s.h5")
    problem = made(path, grid="5,6")
    expected = 1e-3 * HEIGHTS.reshape(6, 2, 5, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(-problem.shape_on(problem.grid), expected, rtol=1e-12)
    np.testing.assert_array_equal(
        problem.shape_on(problem.grid, slice(2, 5)), problem.shape_on(problem.grid)[2:5]
    )
    assert problem.grid.dx * 5 == pytest.approx(1e-3 * DX * NX) and "averaged" in problem.notes[0]
    with pytest.raises(InputError, match=r"has 15 x 12 cells; allowed: -grid 15,12 and whole fractions"):
        made(path, grid="6,6")


def test_both_bodies(saved, tmp_path):
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


ESRI = "ncols 15\nNROWS 12\nxllcorner 0\nyllcorner 0\n{}\nNODATA_value -9999\n"


@pytest.mark.parametrize(
    ("cells", "sides"),
    [("cellsize 0.4", (0.4, 0.4)), ("DX 0,4\ndy 0.5", (0.4, 0.5)), ("cellsize wide", None)],
)
def test_the_head_of_an_esri_grid_says_the_size_of_its_cells(tmp_path, cells, sides):
    """In the unit of x and y, which is told as that of points is."""
    head = ESRI.format(cells)
    np.savetxt(path := tmp_path / "s.asc", HEIGHTS[::-1], fmt="%.9f", header=head, comments="")
    how = {"skip": head.count("\n") + 1, "orient": "flip_y"}
    if sides is None:
        with pytest.raises(InputError, match="s.asc: spacing .*wide.* needed: two positive numbers"):
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
        InputError, match=f"unit of its heights, nor of its cells of 0.4 x {sides[1]}; allowed"
    ):
        read_surface(path, **how)
    for more in ("--skip", how["skip"], "--orient", "flip_y"), ():
        words = [path, "-o", tmp_path / "s.h5", "--unit", "mm", "--height-unit", "um", *more]
        assert convert([*map(str, words)]) == 0
        assert read_surface(tmp_path / "s.h5").spacing == pytest.approx(sides)
        np.testing.assert_allclose(read_surface(tmp_path / "s.h5").heights(), surface.heights(), rtol=1e-12)


@pytest.mark.parametrize(("shape", "what"), [((24, 10), "24 lines of 10"), ((4, 15), "4 lines of 15")])
def test_an_esri_grid_whose_lines_are_no_rows_is_refused(tmp_path, shape, what):
    """Its rows may go on in the next line; cut off, it is another map, too."""
    heights = np.resize(HEIGHTS, shape)
    head = ESRI.format("cellsize 1")
    np.savetxt(path := tmp_path / "s.asc", heights, header=head, comments="")
    for skip in (0, head.count("\n") + 1):
        with pytest.raises(
            InputError, match=f"nrows 12, ncols 15; there are {what} numbers; needed: all rows"
        ):
            read_surface(path, "um", skip=skip)


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


def test_units(saved):
    scales = {
        "m": 1e3,
        "cm": 10,
        "mm": 1,
        "um": 1e-3,
        "nm": 1e-6,
        "pm": 1e-9,
        "Å": 1e-7,
        "\u212b": 1e-7,
        "in": 25.4,
    }
    for unit, scale in scales.items():
        np.testing.assert_allclose(read_surface(saved(HEIGHTS), unit).heights(), scale * HEIGHTS, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "texts", "message"),
    [
        (
            "s.npy",
            {},
            r"-surface_unit\) is missing: surface file .*s.npy does not say the unit .* m, cm, mm, um, nm",
        ),
        (
            "s.npy",
            {"surface_unit": "inch"},
            "-surface_unit inch: must be one of m, cm, mm, um, nm, pm, angstrom, in .µm is um, Å is",
        ),
        ("s.npy", {"surface_unit": "um"}, r"-domain\) is missing: surface file .* does not say its spacing"),
        ("s.h5", {"surface_unit": "nm"}, r"-surface_unit\) nm: surface file .* says um"),
        ("s.txt", {"surface_unit": "nm"}, r"-surface_unit\) nm: surface file .* says um"),
        ("s.h5", {"domain": "0,1,0,1"}, r"its patch is 0.006 x 0.006 mm; the domain is 1 x 1 mm"),
        ("s.h5", {"surface_level": "cubic"}, "-surface_level cubic: must be"),
        ("s.h5", {"surface_crop": "0,16,0,2"}, "surface crop 0,16,0,2: .* columns 0,15 and rows 0,12"),
        ("s.h5", {"surface_crop": "3,3,0,2"}, "-surface_crop 3,3,0,2: must be"),
        ("s.h5", {"surface_missing": "zero"}, "-surface_missing zero: must be"),
        ("none.npy", {}, "surface file .*none.npy: no such file"),
    ],
)
def test_refused(saved, tmp_path, name, texts, message):
    path = saved(HEIGHTS, name) if name in FORMATS else str(tmp_path / name)
    with pytest.raises(InputError, match=message):
        made(path, **texts)


@pytest.mark.parametrize(
    ("value", "message"), [(np.inf, "inf mm in row 0, column 0"), (np.nan, "all points are missing")]
)
def test_heights_of_no_use(saved, value, message):
    with pytest.raises(InputError, match=re.escape(message)):
        read_surface(saved(np.full((4, 4), value)), "um")


def test_a_tilt_is_worth_a_note(saved):
    assert read_surface(saved(HEIGHTS), "um").notes == ()
    assert "tilted by" in read_surface(saved(HEIGHTS + 100 * X), "um").notes[0]
    assert read_surface(saved(HEIGHTS + 100 * X), "um", "plane").notes == ()


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
    surface = read_surface(saved(HEIGHTS, name), None if name in TOLD else "um", orient=orient)
    np.testing.assert_allclose(surface.heights(), 1e-3 * TURNED[orient], rtol=1e-15)
    if surface.spacing:
        turned = orient.count("transpose") % 2
        assert surface.spacing == pytest.approx((1e-3 * DY, 1e-3 * DX) if turned else (1e-3 * DX, 1e-3 * DY))


def test_orientation_is_told_as_on_the_command_line_too():
    by_text, by_names = (
        read_surface(HEIGHTS, "um", orient=orient) for orient in ("transpose,flip_y", ("transpose", "flip_y"))
    )
    np.testing.assert_array_equal(by_text.heights(), by_names.heights())
    assert by_text.orient == by_names.orient and read_surface(HEIGHTS, "um", orient=None).orient == ()


def test_a_part_of_a_map_with_more_cells_than_petsc_can_number(tmp_path):
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("heights", (60_000, 60_000), "f4", chunks=(1000, 1000))
    surface = read_surface(tmp_path / "large.h5", "um", crop=(50_000, 50_015, 40_000, 40_012))
    assert surface.shape == (12, 15) and not surface.heights().any()


def test_crop_counts_after_turning(saved):
    turned = read_surface(saved(HEIGHTS), "um", crop=(1, 4, 2, 10), orient=("transpose",))
    np.testing.assert_allclose(turned.heights(), 1e-3 * HEIGHTS.T[2:10, 1:4], rtol=1e-15)


def test_heights_in_another_unit_than_points(saved):
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


@pytest.mark.parametrize("holes", [False, True])
def test_rms_slope_is_that_about_the_best_plane(saved, holes):
    """Exact for a wave that the cells resolve, whatever the tilt, the runs of rows and the missing points."""
    heights = (
        0.1 * np.sin(2 * np.pi * np.arange(600) / 60)
        + 0.05 * np.cos(2 * np.pi * np.arange(900) / 90)[:, None]
    )
    steps = np.sqrt([np.mean(np.diff(heights, axis=axis) ** 2) for axis in (1, 0)])
    heights += 3 + 0.2 * np.arange(600) - 0.1 * np.arange(900)[:, None]
    if holes:
        heights[:, ::7] = np.nan
    surface = read_surface(saved(heights), "mm")
    assert surface.steps == pytest.approx(tuple(steps), rel=0.01)
    grid = surface.grid((0, 600 * DX, 0, 900 * DY))
    assert surface.rms_slope(grid) == pytest.approx(np.hypot(steps[0] / DX, steps[1] / DY), rel=0.01)
    averaged = surface.averaged((90, 60))
    assert averaged.rms_slope(averaged.grid((0, 600 * DX, 0, 900 * DY))) == pytest.approx(
        surface.rms_slope(grid)
    )


@pytest.mark.parametrize("tilt", [0, 1e3])
@pytest.mark.parametrize("run", [1, 3, 4, 12])
def test_the_point_that_stands_out_most_is_found_whatever_is_read_at_a_time(monkeypatch, run, tilt):
    """About the best plane, however tilted that is."""
    heights = HEIGHTS + tilt * (X - 2 * Y)
    heights[np.random.default_rng(3).random(heights.shape) < 0.2] = np.nan
    heights[7, 4] += 9
    flat = read_surface(heights, "mm", "plane").heights()
    j, i = np.indices(heights.shape) + 1
    beyond = np.pad(flat, 1, constant_values=np.nan)
    beside = np.fmax.reduce([beyond[j + dj, i + di] for dj, di in ((1, 0), (-1, 0), (0, 1), (0, -1))])
    expected = np.nanmax(flat - beside)
    monkeypatch.setattr(moments, "RUN", run * NX)
    found, _, row, column = read_surface(heights, "mm").spike
    assert found == pytest.approx(expected) and (flat - beside)[row, column] == pytest.approx(expected)
    crop = (column, NX, row, NY)  # numbers are those of the whole file
    assert read_surface(heights, "mm", crop=crop).spike[2:] == (row, column)


def test_spikes_are_told_and_surfaces_are_not(saved):
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(200, 300))
    smooth = np.cumsum(np.cumsum(noise, axis=0), axis=1)
    edge = np.where(np.indices(noise.shape)[1] > 150, 50.0, 0.0) + 0.01 * noise
    for heights in (noise, smooth, edge, np.zeros((200, 300)), noise[:1], noise[:1, :1]):
        assert note_spike(read_surface(heights, "um")) is None
    noise[120, 30] += 100
    noise[120, 31] = np.nan
    surface = read_surface(noise, "um", spacing=(0.001, 0.001))
    assert "row 120, column 30 stands 101 um above all beside it" in note_spike(surface)
    filtered = surface.filtered(surface.grid(), s_filter=0.005)
    assert note_spike(filtered) == note_spike(surface)  # smeared, but still there
    assert note_spike(read_surface(-noise, "um")) is None  # pits carry nothing
    found = solve(
        ContactProblem(surface.grid(), Material.from_contact_modulus(1e3), surfaces=[surface]), load=0.01
    )
    assert sum("has spikes" in note for note in found.notes) == 1


@pytest.mark.parametrize("tilt", [(0, 0), (0.5, 0.3), (-20, 7), (1e3, 0)])
def test_a_spike_is_named_on_a_tilt_and_a_tilt_is_no_spike(tilt):
    noise = 0.03 * np.random.default_rng(2).normal(size=(40, 60))
    heights = noise + tilt[0] * np.arange(60) + tilt[1] * np.arange(40)[:, None]
    assert note_spike(read_surface(heights, "um")) is None
    heights[12, 30] += 2
    assert "row 12, column 30 stands " in note_spike(read_surface(heights, "um"))


@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("heights", "level"),
    [
        (0.1 * X - 0.7 * Y, "none"),
        (1 / 3 + 0 * HEIGHTS, "mean"),
        (1e3 * X + Y / 7, "plane"),
        (300 + X**2 - X * Y / 3, "quadratic"),
        (np.pi * Y + 0 * X, "none"),
        (0.011 * X + 0.26 * Y + 350, "mean"),
    ],
)
def test_rounding_is_neither_spikes_nor_flatness(heights, level, precision):
    surface = read_surface(heights.astype(precision), "um", level, spacing=(1e-3, 1e-3))
    assert note_spike(surface) is None
    assert "flatter" not in (note_doubtful_units(surface, surface.grid()) or "")
    assert note_spike(surface.resampled()) is None


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


def test_a_surface_takes_its_own_grid_where_it_knows_the_size_of_its_cells(saved):
    surface = read_surface(saved(HEIGHTS, "s.h5")).averaged((6, 5))
    assert surface.rms_slope() == surface.rms_slope(surface.grid())
    assert surface.understood() == surface.understood(surface.grid())
    with pytest.raises(InputError, match="does not say its spacing"):
        read_surface(HEIGHTS, "um").rms_slope()


@pytest.mark.parametrize("level", moments.LEVELS)
@pytest.mark.parametrize("run", [2, 12])
def test_rms_height_skewness_and_kurtosis_are_those_of_the_heights(monkeypatch, level, run):
    """Whatever the tilt, the runs of rows and the missing points; the last two about plane or bow."""
    monkeypatch.setattr(moments, "RUN", run * NX)
    heights = HEIGHTS**3 + 1e4 * X - 1e5
    heights[2:5, 7:9] = np.nan
    surface = read_surface(heights, "mm", level)
    assert surface.rms_height == pytest.approx(np.nanstd(surface.heights()), rel=1e-6)
    about = "quadratic" if level == "quadratic" else "plane"
    flat = read_surface(heights, "mm", about).heights()
    steps = [np.sqrt(np.nanmean(np.diff(flat, axis=axis) ** 2)) for axis in (1, 0)]
    assert surface.steps == pytest.approx(steps, rel=1e-6)
    flat = flat[~np.isnan(flat)]
    assert (surface.rms_level, surface.skewness, surface.kurtosis) == pytest.approx(
        (flat.std(), *(np.mean(flat**k) / flat.std() ** k for k in (3, 4))), rel=1e-6
    )
    assert f"skewness {surface.skewness:.2g}, kurtosis {surface.kurtosis:.2g};" in surface.understood(
        surface.grid((0, 1, 0, 1))
    )
    assert ("after quadratic level: rms height" in surface.understood(surface.grid((0, 1, 0, 1)))) == (
        level == "quadratic"
    )
    filtered = surface.filtered(surface.grid((0, NX, 0, NY)), s_filter=3)
    assert filtered.rms_height == pytest.approx(np.nanstd(filtered.heights()), rel=1e-6)
    ends = (
        read_surface(np.full((4, 4), 7.0), "mm", spacing=(1, 1)),
        read_surface([[1e45, -1e45, -1e45, 1e45]] * 4, "mm"),
    )
    assert np.isnan(ends[0].skewness) and "skewness" not in str(ends[0])
    assert ends[1].kurtosis == pytest.approx(1)


# What is measured: size of a cell [um], rms slope.
SURFACES = {
    "wafer, AFM": (0.01, 8e-3),
    "polished glass, interferometer": (1.0, 5e-4),
    "lapped gauge block": (1.0, 5e-3),
    "race of a bearing": (1.0, 0.03),
    "ground": (2.0, 0.08),
    "honed": (2.0, 0.1),
    "turned": (5.0, 0.12),
    "cast": (10.0, 0.3),
    "blasted": (2.0, 0.45),
}
MISTAKES = {
    "none": (1, 1),
    "spacing um for mm": (1e3, 1),
    "heights um for mm": (1, 1e3),
    "heights mm for um": (1, 1e-3),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistaken_unit_is_told_and_a_right_one_is_not(saved, mistake):
    """The table of docs/surfaces.md."""
    told, (wider, higher) = 0, MISTAKES[mistake]
    heights = np.random.default_rng(8).normal(size=(48, 64))
    step = np.sqrt(sum(np.mean(np.diff(heights, axis=axis) ** 2) for axis in (0, 1)))
    for cell, slope in SURFACES.values():
        surface = read_surface(saved(higher * slope * cell / step * heights), "um")
        side = 1e-3 * cell * wider
        grid = surface.grid((0, 64 * side, 0, 48 * side))
        problem = ContactProblem(grid, Material.combined(1.0, 0.3), surfaces=[surface])
        told += note_doubtful_units(surface, grid) is not None
        assert "64 x 48 heights in um, cells of " in problem.describe()["surface_read"]
    assert (
        told == {"none": 0, "spacing um for mm": 9, "heights um for mm": 8, "heights mm for um": 7}[mistake]
    )


@pytest.mark.parametrize("shape", [(2, 2), (3, 2), (2, 3), (3, 3), (4, 3)])
def test_few_points_are_points(shape, tmp_path):
    heights = np.random.default_rng(5).normal(size=shape)
    y, x = np.mgrid[: shape[0], : shape[1]]
    points = np.random.default_rng(6).permutation(np.stack([x, 0.5 * y, heights], -1).reshape(-1, 3))
    np.savetxt(tmp_path / "few.txt", points)
    surface = read_surface(tmp_path / "few.txt", "mm")
    assert surface.shape == shape and surface.spacing == pytest.approx((1.0, 0.5))
    np.savetxt(tmp_path / "map.txt", np.random.default_rng(7).normal(size=(6, 3)))
    assert read_surface(tmp_path / "map.txt", "mm").shape == (6, 3)


def test_each_surface_of_a_kind_has_facts_of_its_own(tmp_path):
    np.save(tmp_path / "s.npy", np.random.default_rng(3).normal(size=(8, 8)))
    levels = ["none", "mean", "plane"]
    surfaces = [read_surface(tmp_path / "s.npy", "um", level=level, spacing=(0.1, 0.1)) for level in levels]
    facts = ContactProblem(
        surfaces[0].grid(), Material.from_contact_modulus(1e3), surfaces=surfaces
    ).describe()
    assert [facts[name] for name in ("surface_level", "surface_level2", "surface_level3")] == levels
