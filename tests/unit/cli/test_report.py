"""Web page of a result."""

import base64
import re
import tempfile
from dataclasses import replace

import numpy as np
import pytest
from results import with_attributes

from app import ContactProblem, Grid, Material, Paraboloid, Roller, read_result, solve
from app.api.summary import summary
from app.cli import report, subsurface, xdmf


def test_report_is_one_complete_file(path, made, capsys):
    assert report.main([str(path)]) == 0
    assert capsys.readouterr().out == f"{path.with_suffix('.html')}\n"
    text = path.with_suffix(".html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:|#)', text)  # needs nothing else
    pictures = re.findall(r'src="data:image/png;base64,([^"]*)"', text)
    assert len(pictures) >= 4
    assert all(base64.b64decode(picture).startswith(b"\x89PNG") for picture in pictures)
    for said in (
        f"{made.attributes['load'] / 1e3:.6g} kN", "by at most 0.03%", "first note", "second note",
        "python -m app.solve", "Solved: contact set unchanged", "von Mises", "64 × 48",
    ):  # fmt: skip
        assert said in text, said


def read_back(solution):
    with tempfile.TemporaryDirectory() as folder:
        solution.save(f"{folder}/result.h5")
        return read_result(f"{folder}/result.h5")


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures are not drawn; that takes longest."""
    monkeypatch.setattr(report, "_encode", lambda figure: (b"no picture", 300))


def test_report_has_path_and_missing_knowledge(made, undrawn):
    columns = {"load": np.array([1.0, 2.0]), "approach": np.array([1e-3, -1.6e-3])}
    text = report.web_page(
        replace(
            with_attributes(made, without=["poisson_ratio"], problem="given", converged=False), path=columns
        )
    )
    assert "2 steps." in text and "load [N]" in text and "−0.0016" in text
    assert "Last of 2 steps, load" in text
    alone = replace(made, path={name: column[:1] for name, column in columns.items()})
    alone = report.web_page(alone)
    assert ">1 step.<" in alone and "Last of" not in alone
    assert "NOT SOLVED" in text
    assert "ratio is not known" in text
    diverged = replace(made, pressure=np.full_like(made.pressure, np.nan))
    assert "not finite, so there are no stresses" in report.web_page(diverged, 0.3)
    assert "no stresses" not in report.web_page(diverged, with_stress=False)
    text = report.web_page(with_attributes(made, without=["error_bound"]), with_stress=False)
    assert "Nothing is proved" in text and "von Mises" not in text


def test_table_of_a_path_has_no_nan(made, undrawn):
    columns = {"load": np.arange(3.0), "mean_gap": np.full(3, np.nan), "stiffness": np.array([np.nan, 5, 6])}
    section = report.path_section(replace(made, path=columns), {})
    assert [list(row.values()) for row in section.rows] == [["0", ""], ["1", "5"], ["2", "6"]]
    nothing = replace(made, path={"load": np.full(3, np.nan)})
    assert report.path_section(nothing, {}).texts == ["3 steps."]


def test_report_has_analytic_values_without_rounding(undrawn):
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
        assert numbers[label]["remarks"][0].endswith(f"({100 * off:+.2g}%)")
    assert numbers["load"]["remarks"] == []  # prescribed
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
    assert "analytic 3" in report.web_page(result, with_stress=False).replace("\N{NO-BREAK SPACE}", " ")


def test_report_has_wear_and_background_of_each_cell(made, undrawn):
    values = {"worn_volume": 0.02, "sliding_distance": 4e3, "relaxation_times": [0.1, 10.0], "time": 5.0}
    worn = replace(
        with_attributes(made, **values),
        extra=dict.fromkeys(("background_pressure", "surface_compliance"), np.ones(made.pressure.shape)),
    )
    numbers = {found["label"]: found["value"] for found in report.numbers_section(worn).quantities}
    assert (numbers["worn volume"], numbers["sliding distance"]) == ("0.02 mm3", "4000 mm")
    assert numbers["time"] == "5 s"
    facts = report.request_section(worn).facts
    assert (facts["background_pressure"], facts["relaxation_times"]) == ("of each cell", "0.1, 10 s")
    assert facts["surface_compliance"] == "of each cell"
    uniform = with_attributes(made, background_pressure=2.0, surface_compliance=1e-6)
    facts = report.request_section(uniform).facts
    assert facts["background_pressure"] == "2 N/mm²" and facts["surface_compliance"].startswith("1e-06 mm")


def test_report_has_typographic_minus_and_square(made, undrawn):
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


def test_title_is_that_of_the_user(path, made, undrawn, tmp_path):
    assert report.main([str(path), "-o", str(tmp_path / "r.html"), "--title", "Bearing 7"]) == 0
    assert "<h1>Bearing 7</h1>" in (tmp_path / "r.html").read_text()
    assert "<h1>Bearing 8, NOT" in report.web_page(with_attributes(made, title="Bearing 8", converged=False))


def test_texts_of_users_are_escaped(made, undrawn):
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
        (report, ["absent.h5", "--poisson", "0.7"], "--poisson 0.7: must be from 0 to 0.5"),
        (report, ["RESULT", "--body", "3"], "--body 3: must be 1 or 2"),
        (subsurface, ["RESULT", "--body", "2"], "not those of the bodies"),
        (subsurface, ["RESULT", "--planes", "1"], "no effect without -o"),
        (subsurface, ["RESULT", "--at", "0,1", "--depths", "9"], "--at, --depths: no effect without -o"),
        (report, ["RESULT", "--no-stress", "--poisson", "0.3"], "no effect with --no-stress"),
        (subsurface, ["RESULT", "-o", "TMP", "--planes", "1,-2"], "--planes 1,-2: must be"),
        (subsurface, ["RESULT", "-o", "TMP", "--at", "1"], "must be X,Y"),
        (subsurface, ["RESULT", "-o", "TMP", "--deepest", "1,2"], "one positive number"),
        (xdmf, ["RESULT", "-o", "series.xml"], "must end in .xdmf"),
    ],
)
def test_bad_input_is_one_line(path, tmp_path, capsys, command, arguments, message):
    names = {"RESULT": str(path), "TMP": str(tmp_path), "TMP/r.html": str(tmp_path / "r.html")}
    assert command.main([names.get(argument, argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert list(tmp_path.iterdir()) == [path]


def line_contact():
    grid = Grid.from_domain(64, 64, (-0.5, 0.5, -6, 6))
    return solve(
        ContactProblem(grid, Material.pair((2.1e5, 2.1e5), (0.3, 0.3)), Roller(5.0, 10.0, end_chamfer=0.5)),
        load=5000,
    )


def ring():
    grid = Grid.from_domain(64, 64, (-2, 2, -2, 2))
    return solve(
        ContactProblem(
            grid, Material.from_contact_modulus(1e5), lambda x, y: (np.hypot(x, y) - 1.2) ** 2 / 5
        ),
        load=500,
    )


def test_only_an_ellipse_has_semi_axes():
    roller, circle = read_back(line_contact()), read_back(ring())
    for result, names, text in (
        (
            roller,
            {"load per length": "555.556 N/mm", "half length of the contact": "4.5 mm"},
            "half width of the contact",
        ),
        (circle, {"extent of the contact in x": None}, "extent of the contact in y"),
    ):
        numbers = {row["label"]: row["value"] for row in report.numbers_section(result).quantities}
        assert not any("semi-axis" in name for name in numbers) and text in numbers
        assert all(numbers[name] == value or value is None for name, value in names.items())
        said = summary(result.attributes, result.grid)
        assert text in said and "semi-axes" not in said
    x = result.grid.x()[circle.contact.any(axis=0)]
    assert circle.attributes["contact_extent_x"] == pytest.approx(np.ptp(x) + result.grid.dx)
    turned = read_back(
        solve(
            ContactProblem(
                Grid.from_domain(64, 64, (-1, 1, -1, 1)), Material.from_contact_modulus(1e5),
                lambda x, y: (x + y) ** 2 / 10 + (x - y) ** 2 / 30,
            ),
            load=2000,
        )
    )  # fmt: skip
    assert "elliptic contact: semi-axes" in summary(turned.attributes, turned.grid)


def test_a_number_that_does_not_converge_is_said_to_in_its_row():
    solution = line_contact()
    result = with_attributes(read_back(solution), max_pressure_error=1.0)
    rows = {row["label"]: row["remarks"] for row in report.numbers_section(result).quantities}
    assert rows["maximum pressure"] == ["does not converge with the grid"] and rows["load"] == []
    assert " N/mm2 (does not converge with the grid)\n" in summary(result.attributes, result.grid)


def test_report_has_one_value_of_the_largest_stress_and_no_settings(undrawn):
    result = read_back(line_contact())
    drawn = []
    original, report.figures.summary_figure = (
        report.figures.summary_figure,
        lambda *_, with_stress: drawn.append(with_stress),
    )
    try:
        text = report.web_page(result)
        report.web_page(result, with_stress=False)
    finally:
        report.figures.summary_figure = original
    assert drawn == [False, True]
    assert "-lcp_" not in text and "lcp_rtol" not in text
