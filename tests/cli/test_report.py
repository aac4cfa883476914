"""app.report: one file that says all; app.xdmf and app.subsurface: what they write, and bad input in one line."""

import base64
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from results import MAX_PRESSURE, made_up_result, with_attributes, write

from app import ContactProblem, Grid, Material, Paraboloid, read_result, solve
from app.base.errors import InputError
from app.cli import report, subsurface, xdmf
from app.halfspace.stress.subsurface import von_mises
from app.parallel.slabs import Slabs


@pytest.fixture(scope="module")
def made():
    return with_attributes(made_up_result(64, 48), notes="first note\nsecond note", error_bound=3e-4)


@pytest.fixture
def path(made, tmp_path):
    write(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(48), made)
    return tmp_path / "result.h5"


# -- report ----------------------------------------------------------------------------------------------------


def test_report_is_one_file_with_everything_in_it(path, made, capsys):
    assert report.main([str(path)]) == 0
    assert capsys.readouterr().out == f"{path.with_suffix('.html')}\n"
    text = path.with_suffix(".html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:|#)', text)  # needs nothing else
    pictures = re.findall(r'src="data:image/png;base64,([^"]*)"', text)
    assert len(pictures) >= 4
    assert all(base64.b64decode(picture).startswith(b"\x89PNG") for picture in pictures)
    for said in (
        f"{made.attributes['load']:.6g} N", "within 0.0003", "first note", "second note", "python -m app.solve",
        "Solved: contact set unchanged", "von Mises", "64 × 48",
    ):  # fmt: skip
        assert said in text, said


def read_back(solution):
    with tempfile.TemporaryDirectory() as folder:
        solution.save(f"{folder}/result.h5")
        return read_result(f"{folder}/result.h5")


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures are not drawn; that takes longest."""
    monkeypatch.setattr(report, "_png", lambda figure: b"no picture")


def test_report_has_the_path_and_says_what_is_not_known(made, undrawn):
    columns = {"load": np.array([1.0, 2.0]), "approach": np.array([1e-3, -1.6e-3])}
    text = report.web_page(
        replace(
            with_attributes(made, without=["poisson_ratio"], problem="given", converged=False), path=columns
        )
    )
    assert "2 steps." in text and "load [N]" in text and "−0.0016" in text
    alone = replace(made, path={name: column[:1] for name, column in columns.items()})
    assert ">1 step.<" in report.web_page(alone)
    assert "NOT SOLVED" in text
    assert "ratio is not known" in text
    diverged = replace(made, pressure=np.full_like(made.pressure, np.nan))
    assert "not finite, so there are no stresses" in report.web_page(diverged, 0.3)
    assert "no stresses" not in report.web_page(diverged, with_stress=False)
    text = report.web_page(with_attributes(made, without=["error_bound"]), with_stress=False)
    assert "Nothing is proved" in text and "von Mises" not in text


def test_a_table_of_a_path_has_no_nan(made, undrawn):
    columns = {"load": np.arange(3.0), "moment_x": np.full(3, np.nan), "stiffness": np.array([np.nan, 5, 6])}
    section = report.path_section(replace(made, path=columns), {})
    assert [list(row.values()) for row in section.rows] == [["0", ""], ["1", "5"], ["2", "6"]]
    nothing = replace(made, path={"load": np.full(3, np.nan)})
    assert report.path_section(nothing, {}).texts == ["3 steps."]


def test_report_sets_analytic_values_beside_and_leaves_rounding_out(undrawn):
    """On an even grid Hertz's centre of pressure is 0 but for round-off, whatever is printed."""
    hertz = ContactProblem(
        Grid.from_domain(48, 48, (-3, 3, -3, 3)), Material.combined(8e4, 0.3), Paraboloid(100, 30)
    )
    solution = solve(hertz, load=10000 / 3)
    result = read_back(solution)
    numbers = {found["label"]: found for found in report.numbers_section(result).quantities}
    assert numbers["centre of pressure, x"]["value"] == numbers["centre of pressure, y"]["value"] == "0 mm"
    values = result.attributes
    for name, label in (("approach", "approach"), ("max_pressure", "maximum pressure")):
        off = values[name] / values[f"analytic_{name}"] - 1
        assert numbers[label]["analytic"].endswith(f"({off:+.1e})")
    assert numbers["load"]["analytic"] == ""  # prescribed
    named = with_attributes(result, surface_parts=np.array(["one", "two"], object))
    assert report.request_section(named).facts["surface_parts"] == "one, two"
    facts = report.request_section(result).facts | {"load": report.format_attribute(10000 / 3)}
    assert facts["load"] == "3333.33" and facts["hertz_rx"] == "100 mm"
    other = with_attributes(
        result, young=np.array([1.0, 2.0]), cone_angle=5.0, surface_hurst=0.8, surface_unit="um"
    )
    facts = report.request_section(other).facts
    assert facts["young"] == "1, 2 N/mm²" and facts["cone_angle"] == "5 degrees"
    assert facts["surface_hurst"] == "0.8" and facts["surface_unit"] == "um"
    assert "computed</th><th>analytic" in report.web_page(result, with_stress=False)


def test_report_has_one_sign_for_minus_and_one_for_square(made, undrawn):
    values = {"approach": -1e-7, "notes": "at -2.5 mm, file /m2/a-2.npy: 3e-05 N/mm2", "mean_gap": -0.0}
    values |= {"analytic_approach": -2e-7, "contact_area": 3e-6, "contact_modulus": 1e5, "rms_slope": 0.0}
    result = replace(
        with_attributes(made, **values), path={"load": np.ones(2), "contact_area": np.array([-0.0, -2.0])}
    )
    text = report.web_page(result)
    shown = text[: text.index('id="asked"')]  # options stay as they were typed
    assert "at −2.5 mm, file /m2/a-2.npy: 3e−05 N/mm²" in shown
    assert not re.search(r"[ >(]-\d|\de-\d|mm2|−0[ <]", shown)
    assert "3 µm²" in shown and "contact area [mm²]" in shown and ">−0.1 nm<" in shown


def test_a_load_path_is_read_from_the_file(path):
    with h5py.File(path, "r+") as file:
        file["path/load"] = [3.0, 4.0]
    assert read_result(path).path["load"].tolist() == [3, 4]


def test_text_of_the_user_is_no_markup(made, undrawn):
    text = report.web_page(
        with_attributes(made, notes="a < b & <script>", command_line="<b>"), with_stress=False
    )
    assert "a &lt; b &amp; &lt;script&gt;" in text and "<script>" not in text and "<b>" not in text


@pytest.mark.parametrize(
    "command, arguments, message",
    [
        (report, ["absent.h5"], "absent.h5: no such file"),
        (report, ["RESULT", "-o", "report.pdf"], "must end in .html"),
        (report, ["RESULT", "-o", "/proc/report.html"], "cannot write in /proc"),
        (report, ["RESULT", "-o", "no/report.html"], "no does not exist"),
        (report, ["absent.h5", "--poisson", "0.7"], "--poisson 0.7: must be from 0 to 0.5"),
        (report, ["RESULT", "--body", "3"], "--body 3: must be 1 or 2"),
        (subsurface, ["absent.h5", "--poisson", "-1"], "--poisson -1: must be from 0 to 0.5"),
        (subsurface, ["RESULT", "--poisson", "abc"], "--poisson abc: must be from 0 to 0.5"),
        (subsurface, ["RESULT", "--body", "2"], "not those of the bodies"),
        (subsurface, ["RESULT", "--planes", "1"], "no effect without -o"),
        (
            subsurface,
            ["RESULT", "--section", "y", "--depths", "9"],
            "--section, --depths: no effect without -o",
        ),
        (report, ["RESULT", "--no-stress", "--poisson", "0.3"], "no effect with --no-stress"),
        (subsurface, ["RESULT", "-o", "TMP", "--planes", "1,-2"], "--planes 1,-2: must be"),
        (subsurface, ["RESULT", "-o", "TMP", "--at", "1"], "must be X,Y"),
        (subsurface, ["RESULT", "-o", "TMP", "--at", "-1,2,3"], "must be X,Y"),
        (subsurface, ["RESULT", "-o", "TMP", "--deepest", "1,2"], "one positive number"),
        (subsurface, ["RESULT", "-o", "TMP", "--deepest", "0"], "one positive number"),
        (subsurface, ["RESULT", "-o", "RESULT"], "not a folder"),
        (xdmf, ["absent.h5"], "absent.h5"),
        (xdmf, ["RESULT", "-o", "series.xml"], "must end in .xdmf"),
        (xdmf, ["RESULT", "-o", "/series.xdmf"], "must lie in the folder"),
    ],
)
def test_bad_input_is_one_line(path, tmp_path, capsys, command, arguments, message):
    names = {"RESULT": str(path), "TMP": str(tmp_path), "TMP/r.html": str(tmp_path / "r.html")}
    assert command.main([names.get(argument, argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert list(tmp_path.iterdir()) == [path]


# -- subsurface ------------------------------------------------------------------------------------------------


def test_subsurface_does_not_take_the_place_of_its_result(path, tmp_path, capsys):
    result = path.rename(tmp_path / "subsurface.h5")
    assert subsurface.main([str(result), "-o", str(tmp_path)]) == 2
    assert "is the input" in capsys.readouterr().err
    assert read_result(result).load


@pytest.mark.parametrize("name", ["subsurface.h5", "subsurface.png"])
def test_subsurface_writes_nothing_where_one_of_its_files_cannot_be(path, tmp_path, capsys, name):
    folder = tmp_path / "below"
    (folder / name).mkdir(parents=True)
    assert subsurface.main([str(path), "-o", str(folder)]) == 2
    assert f"{name}: exists and is not a regular file" in capsys.readouterr().err
    assert list(folder.iterdir()) == [folder / name]


def test_subsurface_writes_sections_line_and_planes(path, made, tmp_path, capsys):
    folder = tmp_path / "below"
    assert subsurface.main([str(path), "-o", str(folder), "--planes", "0.5,2", "--depths", "40"]) == 0
    said = capsys.readouterr().out
    assert re.findall("largest (.*) stress .* of the maximum pressure.*\n  at x = .* depth", said) == [
        "von Mises",
        "shear",
    ]
    assert (folder / "subsurface.png").read_bytes().startswith(b"\x89PNG")
    with h5py.File(folder / "subsurface.h5") as file:
        assert 0.55 < file.attrs["max_von_mises"] / MAX_PRESSURE < 0.68
        assert file["section_x/sigma_xx"].shape == (40, 64) and file["section_y/sigma_xy"].shape == (40, 48)
        assert file["plane_1"].attrs["depth"] == 2 and file["plane_1/von_mises"].shape == (48, 64)
        shear, mises = (file[f"plane_1/{name}"][()] for name in ("max_shear", "von_mises"))
        assert 0.28 < file.attrs["max_shear"] / MAX_PRESSURE < 0.34 and file.attrs["max_shear_depth"] > 0
        assert (mises / 2 <= shear * 1.0001).all() and (shear <= 1.0001 * mises / 3**0.5).all()
        assert file["section_x/sigma_zz"].dims[0][0].name == "/depth"
        depth = file["depth"][()]
        k = np.argmin(abs(depth - file.attrs["max_von_mises_depth"]))
        assert file["line/von_mises"][k] == pytest.approx(file.attrs["max_von_mises"], rel=2e-3)
        row = np.argmin(abs(made.y - file.attrs["y"]))
        column = np.argmin(abs(made.x - file.attrs["x"]))
        assert file["section_x/sigma_zz"][:, column] == pytest.approx(file["line/sigma_zz"][()])
        surface = file["section_x/sigma_zz"][0]
        assert surface == pytest.approx(-made.pressure[row], abs=1e-6 * MAX_PRESSURE)


@pytest.mark.parametrize("pressure", [0.0, 7.0])
def test_the_same_stress_everywhere_is_at_no_place(made, pressure):
    """Below a uniform pressure that is repeated for ever no cell is more stressed than others."""
    even = replace(made, pressure=np.full_like(made.pressure, pressure) * (1 + 1e-14 * np.arange(64)))
    periodic = with_attributes(even, periodic_symbol="spectral")
    for result in (periodic, even):  # beside a free patch there is no pressure
        below = subsurface.stress(result)
        texts = subsurface.summary(*below.maxima(), result, below.nu)
        figure = subsurface.draw(result, subsurface.survey(below, depths=9))
        (told,) = figure.axes[0].get_legend().get_texts()
        for text in (*texts, told.get_text()):
            assert ("everywhere" in text) == ("depth" not in text) == (result is periodic or not pressure)


def test_stress_of_a_solution_is_that_of_its_file(tmp_path):
    grid = Grid.from_domain(32, 24, (-1, 1, -0.75, 0.75), periodic=True)
    problem = ContactProblem(
        grid, Material.from_contact_modulus(1e5), lambda x, y: 0.01 * np.cos(np.pi * x) + 0 * y, periodic=True
    )
    solution = solve(problem, mean_pressure=100)
    solution.save(tmp_path / "waves.h5")
    with pytest.raises(InputError, match="Poisson's ratio of the body is not known"):
        subsurface.stress(solution)
    one = subsurface.stress(solution, 0.3).plane(0.1)
    other = subsurface.stress(read_result(tmp_path / "waves.h5"), 0.3).plane(0.1)
    assert von_mises(one) == pytest.approx(von_mises(other))
    assert one[2].mean() == pytest.approx(-100)


def test_poisson_ratio_is_that_of_the_body_asked_for():
    facts = {"poisson": np.array([0.3, 0.35]), "young": np.array([np.inf, 3000.0]), "poisson_ratio": 0.2}
    assert subsurface.find_poisson_ratio(facts) == 0.35  # the other one is rigid
    assert subsurface.find_poisson_ratio(facts, 1) == 0.3
    assert subsurface.find_poisson_ratio({"poisson_ratio": 0.2}) == 0.2
    assert subsurface.find_poisson_ratio({}) is None


# -- xdmf and dimension scales -----------------------------------------------------------------------------------


def items(path):
    """The tree, and arrays of all data items by attribute name."""
    root = ElementTree.parse(path).getroot()
    arrays = {}
    for attribute in root.iter("Attribute"):
        (item,) = attribute
        name, dataset = item.text.split(":")
        with h5py.File(path.parent / name) as file:
            values = file[dataset][()]
        assert tuple(map(int, item.get("Dimensions").split())) == (1, *values.shape)
        assert int(item.get("Precision")) == values.dtype.itemsize
        arrays.setdefault(attribute.get("Name"), []).append(values)
    return root, arrays


def test_xdmf_names_what_is_in_the_file(path, made, capsys):
    assert xdmf.main([str(path)]) == 0
    assert capsys.readouterr().out == f"{path.with_suffix('.xdmf')}\n"
    root, arrays = items(path.with_suffix(".xdmf"))
    assert arrays.keys() == {"pressure", "gap", "displacement", "undeformed_distance", "contact"}
    assert np.array_equal(arrays["pressure"][0], made.pressure)
    assert root.find(".//Topology").get("Dimensions") == "2 49 65"  # points; fields are on cells
    origin, steps = (np.array(item.text.split(), float) for item in root.find(".//Geometry"))
    assert origin[1:] == pytest.approx([-6, -10]) and steps[1:] == pytest.approx([12 / 48, 20 / 64])
    assert origin[0] + steps[0] == 0  # z, whose upper side is the surface


def test_xdmf_of_a_row_of_cells_has_their_size_and_refuses_one_that_is_none(tmp_path, capsys):
    path = tmp_path / "row.h5"
    row = with_attributes(made_up_result(64, 1), cell_size=np.array([0.1, 7.0]))
    write(path, MPI.COMM_SELF, Slabs(1), row)
    assert xdmf.main([str(path)]) == 0
    root, _ = items(path.with_suffix(".xdmf"))
    origin, steps = (np.array(item.text.split(), float) for item in root.find(".//Geometry"))
    grid = read_result(path).grid
    assert [*steps[1:], *origin[1:]] == [grid.dy, grid.dx, grid.y0, grid.x0]
    assert steps[1:] == pytest.approx([7, 20 / 64])
    capsys.readouterr()
    for size in ("wide", -7.0, np.array([0.1, -7.0])):
        with h5py.File(path, "r+") as file:
            file.attrs["cell_size"] = size
        assert xdmf.main([str(path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: result file {path}: ") and said.count("\n") == 1


def test_xdmf_of_a_link_names_the_link(path, tmp_path, capsys):
    folder = tmp_path / "links"
    folder.mkdir()
    (folder / "link.h5").symlink_to(path)
    assert (
        xdmf.main([str(folder / "link.h5"), "-o", str(tmp_path / "a.xdmf")]) == 2
    )  # where there is no link.h5
    assert xdmf.main([str(folder / "link.h5")]) == 0
    assert ">link.h5:/pressure<" in (folder / "link.xdmf").read_text()


def test_xdmf_of_several_results_is_a_series_in_the_order_of_loads(path, made, tmp_path):
    for number, load in enumerate((10.0, 20.0)):
        write(tmp_path / f"{number} & more.h5", MPI.COMM_SELF, Slabs(48), with_attributes(made, load=load))
    files = [str(tmp_path / f"{number} & more.h5") for number in (0, 1)]
    assert xdmf.main([*files, "-o", str(tmp_path / "series.xdmf")]) == 0
    root, arrays = items(tmp_path / "series.xdmf")
    assert root.find(".//Grid").get("CollectionType") == "Temporal"
    assert [time.get("Value") for time in root.iter("Time")] == ["10.0", "20.0"]
    assert len(arrays["pressure"]) == 2


def test_fields_have_their_coordinates_as_dimension_scales(path):
    with h5py.File(path) as file:
        for name in ("pressure", "gap", "displacement", "undeformed_distance", "contact"):
            assert [dimension[0].name for dimension in file[name].dims] == ["/y", "/x"]
        assert all(h5py.h5ds.is_scale(file[name].id) for name in ("x", "y"))
