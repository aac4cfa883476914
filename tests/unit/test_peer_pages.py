"""Pages of run/bench-peers: the ratios in the docs are theirs, and dilute cases are judged."""

import pytest

from app import ContactProblem, ContactSolver
from benchmarks import iterations
from benchmarks.peers import quotes
from benchmarks.peers.__main__ import KINDS, PAGES, main, make_parser
from benchmarks.peers.cases import DiluteCase

PAGE = """# Page

## Times

| problem  | grid  | given | solver        | over ours | note |
|:---------|:------|:------|:--------------|:----------|:-----|
| load 0.3 | 512^2 | load  | this project  | 1.00      |      |
| load 0.3 | 512^2 | load  | aspher: fft   | 26.75     |      |
| load 1   | 512^2 | load  | aspher: fft   | 8.54      |      |
| load 1   | 512^2 | load  | tamaas: P     | 99.00     | does not reach the accuracy |
| load 3   | 512^2 | load  | aspher: fft   | 2.60      |      |
| load 3   | 512^2 | load  | tamaas: P     |           |      |

## Where other packages are better
"""


def test_ratios_are_those_of_accurate_rows():
    rows = quotes.rows_of(PAGE)
    partial = quotes.ratios_of(filter(quotes.is_partial, rows))
    assert partial == {"load": {"aspher": [26.75, 8.54]}}
    assert quotes.ratios_of(filter(quotes.is_full, rows)) == {"load": {"aspher": [2.6]}}


@pytest.mark.parametrize(
    ("ratios", "text"), [([26.75, 8.54], "8.5 to 27"), ([2.6], "2.6"), ([10.2, 9.96], "10"), ([], "")]
)
def test_spread(ratios, text):
    assert quotes.spread(ratios) == text


def test_tables_in_the_docs_are_those_of_the_pages():
    table = quotes.quoted_table()
    for path in quotes.DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        assert quotes.BEGIN in text and quotes.END in text
        assert quotes.replace_table(text, table) == text, f"{path.name}: run/bench-peers --quote"


def test_all_writes_each_quoted_page_with_options_that_are_allowed():
    assert {name for name, *_ in quotes.QUOTES} == set(PAGES)
    parser = make_parser()
    for words in PAGES.values():
        options = parser.parse_args(words)
        assert options.kind in KINDS


def test_dilute_case_accepts_a_solution_and_refuses_others(tmp_path):
    case = DiluteCase("1.5e-3 N", 128, tmp_path)
    assert case.gap.min() == 0 and case.gap.std() == pytest.approx(0.005)
    with ContactSolver(ContactProblem(case.grid, case.material, case.gap)) as solver:
        pressure = solver.solve(load=case.load).pressure
    found = case.judge(pressure, "load")
    assert found["miss"] <= 1 and found["contact_cells"] == (pressure > 0).sum()
    assert case.judge(1.01 * pressure, "load")["load_error"] == pytest.approx(0.01)
    moved = case.judge(pressure[::-1], "load")
    assert moved["residual"] > 1e-2 and moved["load_error"] < 1e-12


def test_iterations_keeps_numbers_and_forgets_failures(tmp_path):
    (tmp_path / "notebook").mkdir()
    stem = tmp_path / "notebook" / "counts"
    facts = {"iterations": 3, "residual": "1e-7", "note": ""}
    rows = [
        {"problem": name, "cells": cells, "solver": solver, "applications": count} | facts
        for name in iterations.PROBLEMS
        for solver in iterations.LABELS
        for cells, count in ((64, "10.5"), (128, ""))
    ]
    iterations.write(rows, stem)
    assert "10.5" in stem.with_suffix(".md").read_text() and (tmp_path / "counts.png").stat().st_size > 1000
    kept = iterations.read_rows(stem.with_suffix(".csv"))
    assert len(kept) == 9 and {row["cells"] for row in kept} == {64}


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--all", "--sizes", "64"], "--sizes: has no effect with --all"),
        (["--all", "nothing"], "unknown: nothing"),
        (["--dilute", "--only", "tamaas"], "unknown: tamaas"),
    ],
)
def test_wrong_options_are_refused_before_any_work(words, what, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["run/bench-peers", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2 and what in capsys.readouterr().err
