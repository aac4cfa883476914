"""Web page of a result."""

import base64
import re
import tempfile
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from results import made_up_result, with_attributes, write

from app import ContactProblem, Grid, Material, Paraboloid, read_result, solve
from app.cli import report
from app.parallel.slabs import Slabs


@pytest.fixture(scope="module")
def made():
    return with_attributes(made_up_result(64, 48), notes="first note\nsecond note", error_bound=3e-4)


@pytest.fixture
def path(made, tmp_path):
    write(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(48), made)
    return tmp_path / "result.h5"


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


def test_text_of_the_user_is_no_markup(made, undrawn):
    text = report.web_page(
        with_attributes(made, notes="a < b & <script>", command_line="<b>"), with_stress=False
    )
    assert "a &lt; b &amp; &lt;script&gt;" in text and "<script>" not in text and "<b>" not in text
