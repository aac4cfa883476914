"""Reproduction: the paper's data, how its numbers are counted, what the report says, and what stays on disk."""

import json
import re

import numpy as np
import pytest

from app.paper import reproduce, tables
from app.paper.item import FULL, QUICK
from app.parameter_study import batch

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


def test_every_run_is_listed(folder):
    lines = (folder / "runs/table8.csv").read_text().splitlines()
    assert len(lines) == 11 and all("punch.opts" in line for line in lines[1:])


def test_page_shows_all_that_there_is_in_order(folder):
    text = (folder / "report.md").read_text()
    assert re.findall(r"^## (.*?):? ", text, re.MULTILINE) == [
        "Table", "Table", "Table", "Figure", "Figure",
    ]  # fmt: skip
    pictures = re.findall(r"^!\[[^]]+\]\((.*)\)$", text, re.MULTILINE)
    assert pictures == ["fig5.png", "fig8.png"]
    assert all((folder / name).is_file() for name in pictures)
    assert "--quick" in text


def test_second_call_repeats_no_run(folder, capsys, monkeypatch):
    def no_run(*arguments):
        raise AssertionError("all is done already")

    monkeypatch.setattr(batch, "perform", no_run)
    before = json.loads((folder / "tables.json").read_text())
    assert reproduce.main(["table8", "fig2", "-o", str(folder), "--quick"]) == 0
    assert json.loads((folder / "tables.json").read_text())["table8"] == before["table8"]
    assert (folder / "report.md").read_text().count("![") == 1
    out = capsys.readouterr().out
    assert "paper" in out and "ours" in out and "table8" in out
    assert not (folder / "work").exists()


# -- without runs --------------------------------------------------------------------------------------------


def test_failed_run_leaves_its_item_out(tmp_path, capsys, monkeypatch):
    failed = {"exit_status": 1, "message": "ValueError: broken"}
    monkeypatch.setattr(batch, "perform", lambda *arguments: failed)
    assert reproduce.main(["table2", "fig10", "-o", str(tmp_path / "out"), "--quick"]) == 1
    assert "table2: left out, because a run failed: 32 V11: ValueError: broken" in capsys.readouterr().err
    assert json.loads((tmp_path / "out/tables.json").read_text()).keys() == {"source"}
    assert not (tmp_path / "out/runs/table2.csv").exists()
    assert (tmp_path / "out/fig10.png").is_file() and (tmp_path / "out/report.md").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["table9", "-o", "out"], "item table9: unknown; allowed: table1"),
        (["table1"], "-o"),
        (["table1", "-o", "file"], "not a folder"),
        (["table1", "-o", "absent/out"], "does not exist"),
        (["table1", "-o", "out", "--jobs", "none"], "at least 1"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert reproduce.main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert not (tmp_path / "out").exists()


def test_all_is_everything_once_and_in_the_order_of_the_report():
    names = [item.name for item in reproduce.select_items(["all"])]
    assert names[:8] == [f"table{k}" for k in range(1, 9)]
    assert {"fig2", "fig5", "fig6", "fig7", "fig8", "fig10", "fig11", "fig12"} < set(names)
    assert len(names) == len(set(names))
    assert [item.name for item in reproduce.select_items(["fig7", "table2", "fig7"])] == ["table2", "fig7"]


@pytest.mark.parametrize("name", [f"table{k}" for k in range(1, 9)])
def test_plans_cover_the_whole_table_of_the_paper(name):
    (item,) = reproduce.select_items([name])
    expected = {(size, column) for size, row in tables.PAPER[name].items() for column in row}
    assert item.plan(FULL).keys() == expected
    quick = item.plan(QUICK)
    assert quick and quick.keys() < expected
    assert all(int(size) <= QUICK for size, _ in quick)
