"""Reproduction: the paper's data, how its numbers are counted, what the report says, and what stays on disk."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from app import reproduce, sweep
from app.halfspace.influence import Material, influence_quadrant
from app.reproduction import pictures, report, studies, tables
from app.reproduction.item import FULL, QUICK
from app.reproduction.report import Entry

CYCLES = {"V11", "V10", "V01"}


# -- a real run ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Some items on small grids."""
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    assert reproduce.main(["table1", "table4", "table8", "fig8", "fig5", "-o", str(folder), "--quick"]) == 0
    return folder


@pytest.fixture(scope="module")
def numbers(folder):
    return json.loads((folder / "tables.json").read_text())


def test_keys_are_those_of_the_paper(numbers):
    assert numbers.keys() == {"source", "table1", "table4", "table8"}
    for name in ("table1", "table4", "table8"):
        for size in numbers[name].keys() - {"what"}:
            assert numbers[name][size].keys() == tables.PAPER[name][size].keys()


def test_first_contact_set_takes_the_cycles_of_the_paper(numbers):
    for omega, (cycles, factor) in tables.PAPER["table1"]["64"].items():
        assert numbers["table1"]["64"][omega][0] == cycles
        assert numbers["table1"]["64"][omega][1] == pytest.approx(factor, abs=0.015)


def test_full_multigrid_ends_at_the_discretisation_error(numbers):
    discrete = [numbers["table4"][size]["discrete"] for size in ("8", "16", "32", "64")]
    ratios = np.divide(discrete[:-1], discrete[1:])
    assert ((ratios > 1.4) & (ratios < 2.6)).all()  # first order in the cell size
    for size in ("8", "16", "32", "64"):
        errors, paper = numbers["table4"][size]["errors"], tables.PAPER["table4"][size]
        assert errors[-1] == pytest.approx(numbers["table4"][size]["discrete"], rel=1e-3)
        assert errors[0] == pytest.approx(paper["errors"][0], rel=0.01)
        assert numbers["table4"][size]["discrete"] == pytest.approx(paper["discrete"], rel=0.03)


def test_inexact_cg_is_within_an_iteration_of_the_paper(numbers):
    for size in ("32", "64"):
        for k, (iterations, work) in numbers["table8"][size].items():
            assert work == iterations * (int(k) + 2)
            assert abs(iterations - tables.PAPER["table8"][size][k][0]) <= 1


def test_every_run_is_listed_and_its_conditions_are_checked(folder):
    rest = json.loads((folder / "report.json").read_text())
    check = rest["checks"]["table8"]
    assert check["runs"] == 10 and check["not_converged"] == 0
    assert -1e-5 < check["worst_negative_gap"] <= 0 and check["worst_negative_pressure"] == 0
    assert 0 <= check["complementarity"] < 1e-5
    lines = (folder / "runs/table8.csv").read_text().splitlines()
    assert len(lines) == 11 and all("punch.opts" in line for line in lines[1:])


class Page(HTMLParser):
    """Collects what a page shows, and checks that tags are closed in order."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.links, self.ids = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.links += [attributes["href"]] if "href" in attributes else []
        if tag == "img":
            self.sources.append(attributes["src"])
            assert attributes["alt"]
        elif tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_holds_all_it_shows(folder):
    text = (folder / "report.html").read_text()
    page = Page(text)
    assert len(page.sources) == 2 and all(s.startswith("data:image/png;base64,iVBOR") for s in page.sources)
    assert sorted(page.links) == sorted(f"#{name}" for name in page.ids)
    assert page.ids == ["table1", "fig5", "fig8", "table4", "table8", "checks"]
    assert "--quick" in text


def test_markdown_has_paper_ours_and_difference(folder):
    text = (folder / "tables.md").read_text()
    assert re.search(r"\| 64 × 64 +\| ω = 0.8 +\| 9 \(0.19\) +\| 9 \(0\.\d\d\) +\| \+0 ", text)
    assert text.count("## Table") == 3


def test_second_call_goes_on_and_adds(folder, capsys, monkeypatch):
    def no_run(*arguments):
        raise AssertionError("all is done already")

    monkeypatch.setattr(sweep, "perform", no_run)
    before = (folder / "tables.json").read_text()
    assert reproduce.main(["table8", "fig2", "-o", str(folder), "--quick"]) == 0
    assert json.loads((folder / "tables.json").read_text()) == json.loads(before)
    assert len(Page((folder / "report.html").read_text()).sources) == 3
    out = capsys.readouterr().out
    assert "paper" in out and "ours" in out and "table8" in out
    assert not (folder / "work").exists()


# -- without runs --------------------------------------------------------------------------------------------


def test_failed_run_leaves_its_item_out(tmp_path, capsys, monkeypatch):
    failed = {"exit_status": 1, "message": "ValueError: broken"}
    monkeypatch.setattr(sweep, "perform", lambda *arguments: failed)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/tables.json").write_text('{"source": "", "table1": {"64": {"0.8": [9, 0.2]}}}')
    assert reproduce.main(["table1", "fig10", "-o", str(tmp_path / "out"), "--quick"]) == 1
    assert "table1: left out, because a run failed: 64 0.8: ValueError: broken" in capsys.readouterr().err
    assert json.loads((tmp_path / "out/tables.json").read_text()).keys() == {"source"}
    assert (tmp_path / "out/fig10.png").is_file() and (tmp_path / "out/report.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["table9", "-o", "out"], "item table9: unknown; allowed: table1"),
        (["table1"], "-o"),
        (["table1", "-o", "file"], "not a folder"),
        (["table1", "-o", "absent/out"], "does not exist"),
        (["table1", "-o", "out", "--jobs", "none"], "at least 1"),
        (["table1", "-o", "broken"], "tables.json: is not JSON"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/tables.json").write_text("{")
    assert reproduce.main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert not (tmp_path / "out").exists()


def test_all_is_everything_but_what_is_optional():
    names = [item.name for item in reproduce.select(["all"])]
    assert names[:8] == [f"table{k}" for k in range(1, 9)]
    assert {"fig2", "fig5", "fig6", "fig7", "fig8", "fig10", "fig11", "fig12", "seeds", "inexact"} < set(
        names
    )
    assert "beyond" not in names and len(names) == len(set(names))
    assert [item.name for item in reproduce.select(["fig7", "table2", "fig7"])] == ["table2", "fig7"]
    placed = [item.name for item in reproduce._reading_order()]
    assert sorted(placed) == sorted(reproduce.ITEMS)


@pytest.mark.parametrize("name", [f"table{k}" for k in range(1, 9)])
def test_plans_cover_the_whole_table_of_the_paper(tmp_path, name):
    (item,) = reproduce.select([name])
    expected = {(size, column) for size, row in tables.PAPER[name].items() for column in row}
    assert item.plan(FULL, tmp_path).keys() == expected
    quick = item.plan(QUICK, tmp_path)
    assert quick and quick.keys() < expected
    assert all(int(size) <= QUICK.largest for size, _ in quick)


def test_counts_of_the_paper():
    outcome = {
        "converged": True, "active_set_iterations": 6, "work_units": 26.25, "inner_iterations": 71,
    }  # fmt: skip
    data = tables.evaluate_methods({("32", "V11"): outcome, ("32", "norm_cg"): outcome})
    assert data == {"32": {"V11": [6, 26.2], "norm_cg": [6, 71]}}
    assert tables.inexact_counts(outcome, 4) == [6, 36]
    assert tables.inexact_counts({**outcome, "converged": False}, 4) is None


@pytest.mark.parametrize(
    ("paper", "ours", "difference", "noticeable"),
    [
        ([9, 35], [9, 35.4], "+0 (+1%)", False),
        ([7, 24], [8, 27], "+1 (+12%)", True),
        ([20, 200], [18, 190], "-2 (-5%)", True),
        ([9, 0.19], [9, 0.204], "+0 (+0.01)", False),
        ([9, 0.19], [9, 0.25], "+0 (+0.06)", True),
        (45.29, 45.06, "-1%", False),
        (3.70, 4.18, "+13%", True),
        (None, [21, 126], "one diverged", True),
        (None, None, "", False),
    ],
)
def test_differences(paper, ours, difference, noticeable):
    entry = Entry("32 × 32", "V(1,1)", paper, ours)
    assert (entry.difference(), entry.noticeable) == (difference, noticeable)


def test_verdict_names_what_differs():
    same, other = Entry("a", "b", [9, 35], [9, 35.4]), Entry("c", "d", [9, 35], [5, 35])
    assert (
        report.verdict([same])
        == "1 entries, 1 of them equal in all digits printed; no noticeable difference."
    )
    assert report.verdict([same, other]).endswith("noticeably different: c d.")


def test_numbers_are_written_as_in_the_paper():
    assert [report.show(v) for v in ([9, 0.194], [9, 35.4375], [5, 110], 45.286, None)] == [
        "9 (0.19)", "9 (35)", "5 (110)", "45.29", "diverged",
    ]  # fmt: skip


def test_spread_and_slope():
    assert studies.spread([3, None, 1, 2, 10]) == [1, 2.5, 10]
    assert studies.spread([None]) is None
    points = [{"share": 0.1, "pressure": 0.05}, {"share": 0.32, "pressure": 0.15}]
    assert studies.kappa(points) == pytest.approx(2.1)


def test_self_affine_loads_are_in_units_of_the_slope_on_the_patch(tmp_path):
    plan = studies.plan_selfaffine(QUICK, tmp_path)
    for (load, seed, slope), run in plan.items():
        height = -np.load(run.options["gap_file"])
        cell = studies.SIDE / len(height)
        gradient = np.gradient(height, cell)
        assert float(slope) == pytest.approx(np.sqrt(sum(np.mean(g**2) for g in gradient)), rel=0.05)
        assert float(slope) == pytest.approx(studies.SLOPE, rel=0.15)
        pressure = float(run.options["load"]) / studies.SIDE**2
        assert pressure / studies.MATERIAL.contact_modulus / float(slope) == pytest.approx(float(load))
        assert f"-{seed}.npy" in run.options["gap_file"]


# -- pictures ------------------------------------------------------------------------------------------------


def drawn(name, outcomes=None):
    (item,) = reproduce.select([name])
    return item.evaluate(outcomes or {})


@pytest.mark.parametrize("name", ["fig2", "fig5", "fig6", "fig7", "fig10", "fig12"])
def test_panels_are_lettered_and_axes_labelled(name):
    panels = [axes for axes in drawn(name).axes if axes.get_label() != "<colorbar>"]
    titles = [axes.get_title(loc="left") for axes in panels]
    assert [title[:3] for title in titles] == [f"({letter})" for letter in "abcdef"[: len(panels)]]
    outer = [axes for axes in panels if not (name == "fig10" and axes in panels[:2])]
    assert all(axes.get_xlabel() for axes in outer)
    assert panels[0].get_ylabel() and panels[-2 if name == "fig10" else -1].get_ylabel()


def test_figure_2_shows_the_coefficients_in_their_places():
    image = drawn("fig2").axes[0].images[0]
    values = np.asarray(image.get_array())
    material = Material(82000.0, 0.28)
    grid = pictures.Grid.from_domain(32, 32, pictures.HERTZ_DOMAIN)
    quadrant = material.shear_modulus * influence_quadrant(grid, material.compliance)
    assert values.shape == (33, 33)
    for j, i in ((0, 0), (3, 5), (-16, 16), (7, -2)):
        assert values[16 + j, 16 + i] == pytest.approx(quadrant[abs(j), abs(i)])


def test_figure_5_shows_all_eigenvalues():
    first, second, third = drawn("fig5").axes
    jacobi = first.lines[0].get_ydata()
    assert len(jacobi) == 32 and jacobi.min() == pytest.approx(-19.8, abs=0.05)
    points = second.lines[-1].get_xydata()
    assert np.sort(np.hypot(*points.T)) == pytest.approx(np.sort(third.lines[0].get_ydata()))


def test_figure_12_normal_plot_is_nearly_straight():
    axes = next(axes for axes in drawn("fig12").axes if axes.get_ylabel() == "probability")
    height, quantile = axes.lines[0].get_data()
    assert len(height) == 64**2
    assert np.corrcoef(height, quantile)[0, 1] > 0.99


def test_contact_panels_show_start_and_end():
    n = 4
    fields = {"x": list(range(n)), "y": list(range(n)), "admissible": np.ones((n, n), int).tolist()}
    full, empty = np.ones((n, n), int).tolist(), np.zeros((n, n), int).tolist()
    outcomes = {("1", m): {**fields, "first": full, "last": empty} for m in ("norm", "fmg_v11")}
    titles = [axes.get_title(loc="left") for axes in drawn("fig8", outcomes).axes]
    assert "16 cells, 16 unlike the last" in titles[0] and titles[2].endswith("converged\n0 cells")
