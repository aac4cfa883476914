"""Sweeps as commands: rows, resume, ranks."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from processes import FMG, HERTZ, NORM, TESTS, write_sweep

from app.cli.sweep import main
from app.contact.grid_errors import GridErrors
from app.io.result import read_result
from app.parameter_study.batch import make_rows, run_all
from app.parameter_study.journal import Journal
from app.parameter_study.processes import perform
from app.parameter_study.run import CHECKS, Run
from app.parameter_study.sweep_file import read_sweep
from app.plots.sweeps import sweep_figure

ROOT = TESTS.parent


def test_sweep_of_the_docs_is_solved(tmp_path, monkeypatch, cli_here):
    """Two methods, grids and materials, three loadings, less one of them on one of the grids."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs/commands.md").read_text().partition("```yaml\n")[2].partition("```")[0]
    runs = read_sweep(write_sweep(tmp_path, text))
    assert len(runs) == 2 * 2 * (2 * 3 - 1)
    for run in runs:
        done = cli_here(*run.arguments(), cwd=tmp_path)
        assert done.returncode == 0, (run.arguments(), done.stderr)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A small sweep: two solved, one refused, one that does not converge."""
    folder = tmp_path_factory.mktemp("sweep")
    path = write_sweep(
        folder,
        f"option_files: [{HERTZ}, {NORM}]\noptions: {{grid: 8}}\n"
        "zip: [{approach: [0.05, 0.1, ten, 0.1], lcp_max_it: [~, ~, ~, 1]}]",
    )
    assert main([str(path), "-o", str(folder / "out.csv"), "--keep", "--jobs", "2"]) == 3
    with (folder / "out.csv").open() as file:
        return folder, list(csv.DictReader(file))


def test_each_combination_is_a_row(swept):
    _, rows = swept
    assert [row["approach"] for row in rows] == ["0.05", "0.1", "ten", "0.1"]
    assert [row["exit_status"] for row in rows] == ["0", "0", "2", "3"]
    assert [row["converged"] for row in rows] == ["True", "True", "", "False"]
    assert [row["result_approach"] for row in rows] == ["0.05", "0.1", "", "0.1"]
    # Hertz: the load grows like approach^1.5; 8 x 8 cells are coarse.
    assert float(rows[1]["load"]) / float(rows[0]["load"]) == pytest.approx(2**1.5, rel=0.1)


def test_refused_and_unfinished_rows_say_why(swept):
    _, rows = swept
    assert rows[2]["message"].startswith("error: -approach ten: must be")
    assert "1 active set iterations in a row were not enough" in rows[3]["message"]
    assert rows[2]["load"] == "" and float(rows[3]["load"]) > 0


def test_checks_are_those_of_the_kept_result(swept):
    _, rows = swept
    for row in rows:
        if row["result"]:
            result = read_result(row["result"])
            p, e, h = result.pressure, result.gap, result.undeformed_distance
            expected = max(0, -e.min()), min(0, p.min()), np.abs(p * e).max() / (p.max() * np.abs(h).max())
            assert [float(row[name]) for name in CHECKS] == pytest.approx(expected, rel=1e-12)
            assert float(row["largest_penetration"]) < 1e-6 or row["converged"] == "False"
    assert sum(row["result"] != "" for row in rows) == 3


def test_missing_result_file_repeats_its_run(swept, tmp_path):
    folder, rows = swept
    before = len(journal_keys(folder / "out.runs.jsonl"))
    Path(rows[0]["result"]).unlink()
    assert main([str(folder / "sweep.yml"), "-o", str(folder / "out.csv"), "--keep", "--resume"]) == 3
    assert Path(rows[0]["result"]).is_file()
    assert len(journal_keys(folder / "out.runs.jsonl")) == before + 2  # the refused one has no answer


def test_unreached_refinement_has_its_own_message(tmp_path):
    run = Run((str(HERTZ),), {"grid": "8", "refine_until": "1e-3", "refine_max": "64"})
    outcome = perform(run, tmp_path / "a.h5")
    assert outcome["exit_status"] == 3 and outcome["converged"]
    assert "-refine_max was reached" in outcome["message"]


@pytest.mark.ranks(2)
def test_number_of_ranks_changes_only_times(tmp_path, ranks):
    run = Run((str(HERTZ), str(FMG)), {"grid": "16"})
    outcomes = []
    for n in (1, ranks):
        journal = Journal(tmp_path / f"{n}.jsonl")
        (outcome,), _ = run_all([run], tmp_path / "work", journal, ranks=n)
        journal.close()
        outcomes.append(outcome)
    assert [outcome["exit_status"] for outcome in outcomes] == [0, 0]
    one, two = outcomes
    for name in ("active_set_iterations", "work_units", "contact_fraction"):
        assert one[name] == two[name]
    assert one["load"] == pytest.approx(two["load"], rel=1e-10)
    assert run.key(1) != run.key(ranks)
    assert not (tmp_path / "work").exists()


def test_interrupted_sweep_is_completed_by_resume(tmp_path):
    path = write_sweep(
        tmp_path,
        f"option_files: [{HERTZ}, {NORM}]\nzip: [{{grid: [8, 2048, 8], approach: [0.1, 0.1091, 0.2]}}]",
    )
    output, journal = tmp_path / "out.csv", tmp_path / "out.runs.jsonl"
    command = [sys.executable, "-m", "app.sweep", str(path), "-o", str(output), "--timeout", "20"]
    process = subprocess.Popen(command, cwd=ROOT, env=dict(os.environ), stdout=subprocess.PIPE, text=True)
    wait_for(lambda: journal.is_file() and len(journal_keys(journal)) == 1)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=20)[0].endswith("interrupted: --resume continues after them\n")
    assert process.returncode == 130
    with output.open() as file:
        assert [row["approach"] for row in csv.DictReader(file)] == ["0.1"]
    assert not (tmp_path / "out.runs").exists()
    commands = (path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if path.is_file())
    assert not any(str(tmp_path / "out.runs").encode() in command for command in commands)
    # The long run is dropped; the first is not done again.
    path.write_text(path.read_text().replace("8, 2048, 8", "8, 8").replace("0.1, 0.1091, 0.2", "0.1, 0.2"))
    assert main([str(path), "-o", str(output), "--resume"]) == 0
    assert len(journal_keys(journal)) == 2
    with output.open() as file:
        assert [row["exit_status"] for row in csv.DictReader(file)] == ["0", "0"]


def journal_keys(path):
    return [json.loads(line)["key"] for line in path.read_text().splitlines() if line.endswith("}")]


def wait_for(condition, seconds=30):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_requested_stiffness_has_a_column(tmp_path):
    path = write_sweep(
        tmp_path, f"option_files: [{HERTZ}]\noptions: {{grid: 16, load: 1e4, stiffness: [true, false]}}"
    )
    assert main([str(path), "-o", str(tmp_path / "out.csv")]) == 0
    with (tmp_path / "out.csv").open() as file:
        with_it, without = csv.DictReader(file)
    assert float(with_it["result_stiffness"]) > 1e5 and without["result_stiffness"] == ""
    assert float(with_it["contact_area"]) == pytest.approx(240 * float(with_it["contact_fraction"]))
    assert "stiffness" not in make_rows([Run()], [{"exit_status": 0}])[0]


def test_load_path_has_a_row_for_each_step(tmp_path, capsys):
    """The numbers of a step are those of the run's own table; work is known of the last one only."""
    output = tmp_path / "out.csv"
    path = write_sweep(
        tmp_path,
        "options: {problem: sphere, domain: '-0.4,0.4,-0.4,0.4', contact_modulus: 1e5, grid: 32, "
        "load_path: '1,10,20', sphere_radius: [10, 20, ten]}",
    )
    assert main([str(path), "-o", str(output), "--keep"]) == 3
    said = capsys.readouterr().out
    assert len(list((tmp_path / "out.runs").glob("*.csv"))) == 2
    assert "3 runs" in said and "2 of 3 solved" in said and said.count("error: ") == 1
    with output.open() as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["1", "2", "3"] * 2 + [""]
    assert [row["sphere_radius"] for row in rows] == ["10"] * 3 + ["20"] * 3 + ["ten"]
    assert list(rows[0])[:6] == "sphere_radius exit_status step load contact_fraction max_pressure".split()
    for run in rows[:3], rows[3:6]:
        table = read_result(run[0]["result"]).path
        for name in "load approach indentation contact_area max_pressure mean_contact_pressure".split():
            np.testing.assert_allclose([float(row[name]) for row in run], table[name], rtol=1e-12)
        assert [bool(row["solve_seconds"]) for row in run] == [False, False, True]
        assert {row["contact_modulus"] for row in run} == {"100000.0"}
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    panel = sweep_figure(columns).axes[0]
    assert panel.get_xlabel() == "load F  [N]"
    assert [len(line.get_xdata()) for line in panel.lines] == [3, 3, 0]


def test_known_spots_and_errors_have_columns(tmp_path):
    output = tmp_path / "out.csv"
    path = write_sweep(
        tmp_path, f"option_files: [{HERTZ}, [fast.opts, norm.opts]]\noptions: {{grid: 64, load: 1e4}}"
    )
    assert main([str(path), "-o", str(output), "--keep"]) == 0
    with output.open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        found = read_result(row["result"])
        assert (int(row["contact_patches"]), float(row["largest_patch"])) == tuple(
            found.count_patches().values()
        )
        for name in GridErrors._fields:
            assert row[name] == ("" if np.isnan(getattr(found, name)) else str(getattr(found, name))), name
    assert [float(rows[0][f"{name}_error"]) > 0 for name in ("approach", "max_pressure", "contact_area")] == [
        True
    ] * 3
    assert not any(rows[1][name] for name in GridErrors._fields)
