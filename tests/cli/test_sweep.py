"""Sweeps as commands: rows, resume, bad input."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from processes import TESTS
from results import full_disk

from app.cli.sweep import SUFFIXES, main
from app.contact.grid_errors import GridErrors
from app.io.result import read_result
from app.parameter_study import batch
from app.parameter_study.batch import make_rows, run_all
from app.parameter_study.journal import Journal
from app.parameter_study.processes import perform
from app.parameter_study.run import CHECKS, Run
from app.parameter_study.sweep_file import read_sweep
from app.plots.sweeps import sweep_figure

ROOT = TESTS.parent


HERTZ = ROOT / "petsc_options/hertz.opts"


NORM = ROOT / "petsc_options/norm.opts"


FMG = ROOT / "petsc_options/fmg_v11.opts"


def write(tmp_path, text):
    path = tmp_path / "sweep.yml"
    path.write_text(text)
    return path


BAD = {
    "options: [1, 2]": "mapping",
    "options: {grid: 8": "line 1: expected ',' or '}'",
    "[" * 3000: "recursion",
    "options: {grid: 8, grid: 16}": "grid is given twice",
    "options: {grid: 8}\nzip: [{grid: [1, 2]}]": "grid: is given twice",
    "options: {-grid: 8}": "without dash",
    "options: {grid: []}": "empty",
    "options: {grid: {a: 1}}": "number or text",
    "options: {grid: [[8, [8]]]}": "number or text",
    "options: {grid: [[]]}": "number or text",
    "options: {grid: 8}\noption_files: [[]]": "empty",
    "options: {grid: 8, Grid: 16}": "Grid: is given twice",
    "options: {output: a.h5}": "output: not allowed",
    "options: {Output: a.h5}": "Output: not allowed",
    "option: {grid: 8}": "unknown key option",
    "options: {grid: 8}\nzip: [{approach: [1, 2], load: [1, 2, 3]}]": "approach 2, load 3",
    "options: {grid: 8}\nzip: {approach: [1]}": "zip: must be a list",
    "options: {grid: 8}\nexclude: [{grdi: 8}]": "grdi is not among",
    "options: {grid: 8}\nexclude: [{grid: 8}]": "no combination",
    "options: {grid: 8}\nexclude: [{}]": "must name an option",
    "option_files: [absent.opts]": "absent.opts: no such file",
    "description: nothing": "neither",
    f"options: {{{', '.join(f'{name}: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]' for name in 'abcdefghi')}}}": (
        "1000000000 combinations; at most 100000"
    ),
    "": "mapping",
    "- 1": "mapping",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_sweep_is_one_line_and_nothing_is_written(tmp_path, capsys, text):
    path = write(tmp_path, text)
    assert main([str(path), "-o", str(tmp_path / "out.csv")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ") and err.count("\n") == 1
    assert BAD[text] in err
    assert [file.name for file in tmp_path.iterdir()] == ["sweep.yml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["absent.yml", "-o", "out.csv"], "absent.yml"),
        (["sweep.yml"], "-o"),
        (["sweep.yml", "-o", "out.xls"], "must end in .csv or "),
        (["sweep.yml", "-o", "absent/out.csv"], "does not exist"),
        (["sweep.yml", "-o", "gap.csv"], "is the input gap.csv"),
        (["sweep.yml", "-o", "folder.csv"], "not a regular file"),
        (["sweep.yml", "-o", "out.csv", "--jobs", "0"], "at least 1"),
        (["sweep.yml", "-o", "out.csv", "--ranks", "two"], "at least 1"),
        (["sweep.yml", "-o", "out.csv", "--timeout", "-1"], "positive"),
    ],
)
def test_bad_command_line_is_one_line(tmp_path, capsys, monkeypatch, arguments, message):
    write(tmp_path, "options: {grid: 8, gap_file: gap.csv}")
    (tmp_path / "gap.csv").write_text("1 2")
    (tmp_path / "folder.csv").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err


def test_the_sweep_of_the_docs_is_solved(tmp_path, monkeypatch, cli_here):
    """Two methods, grids and materials, three loadings, less one of them on one of the grids."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs/commands.md").read_text().partition("```yaml\n")[2].partition("```")[0]
    runs = read_sweep(write(tmp_path, text))
    assert len(runs) == 2 * 2 * (2 * 3 - 1)
    for run in runs:
        done = cli_here(*run.arguments(), cwd=tmp_path)
        assert done.returncode == 0, (run.arguments(), done.stderr)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A small sweep: two solved, one refused, one that does not converge."""
    folder = tmp_path_factory.mktemp("sweep")
    path = write(
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


def test_a_missing_kept_file_is_made_again(swept, tmp_path):
    folder, rows = swept
    before = len(journal_keys(folder / "out.runs.jsonl"))
    Path(rows[0]["result"]).unlink()
    assert main([str(folder / "sweep.yml"), "-o", str(folder / "out.csv"), "--keep", "--resume"]) == 3
    assert Path(rows[0]["result"]).is_file()
    assert len(journal_keys(folder / "out.runs.jsonl")) == before + 2  # the refused one has no answer


def test_a_solution_of_a_run_that_is_not_fine_enough_is_not_why(tmp_path):
    run = Run((str(HERTZ),), {"grid": "8", "refine_until": "1e-3", "refine_max": "64"})
    outcome = perform(run, tmp_path / "a.h5")
    assert outcome["exit_status"] == 3 and outcome["converged"]
    assert "-refine_max was reached" in outcome["message"]


@pytest.mark.ranks(2)
def test_ranks_change_the_time_only(tmp_path, ranks):
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


def test_interrupt_leaves_a_table_and_resume_completes_it(tmp_path):
    path = write(
        tmp_path,
        f"option_files: [{HERTZ}, {NORM}]\nzip: [{{grid: [8, 2048, 8], approach: [0.1, 0.1091, 0.2]}}]",
    )
    output, journal = tmp_path / "out.csv", tmp_path / "out.runs.jsonl"
    command = [sys.executable, "-m", "app.sweep", str(path), "-o", str(output), "--timeout", "20"]
    process = subprocess.Popen(command, cwd=ROOT, env=dict(os.environ), stdout=subprocess.PIPE, text=True)
    wait_for(lambda: journal.is_file() and len(journal_keys(journal)) == 1)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=20)[0].endswith("interrupted: --resume goes on after them\n")
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


@pytest.mark.parametrize(("statuses", "expected"), [("000", 0), ("222", 2), ("022", 3), ("33", 3), ("2-", 3)])
def test_exit_status_is_that_of_the_runs(tmp_path, capsys, monkeypatch, statuses, expected):
    """And what several runs say is said once."""
    outcomes = iter([{"exit_status": -9 if s == "-" else int(s), "message": s.strip("0")} for s in statuses])
    monkeypatch.setattr(batch, "perform", lambda *how: next(outcomes))
    path = write(tmp_path, f"options: {{grid: [{', '.join('123'[: len(statuses)])}]}}")
    assert main([str(path), "-o", str(tmp_path / "out.csv")]) == expected
    *_, last = lines = capsys.readouterr().out.splitlines()
    assert last.endswith(f"{statuses.count('0')} of {len(statuses)} solved")
    expected = {"222": ["all runs: 2"], "022": ["grid 2; grid 3: 2"]}
    assert statuses not in expected or lines[-2:-1] == expected[statuses]


@pytest.fixture
def performed(monkeypatch):
    """Replace the program by one that solves at once; return the list of what was run."""
    calls = []

    def perform(run, output, processes, ranks=1, timeout=None):
        calls.append(dict(run.options))
        status = {"crash": 1, "refused": 2}.get(run.options.get("grid"), 0)
        return {"exit_status": status, "message": "", "load": np.float64(len(calls))}

    monkeypatch.setattr(batch, "perform", perform)
    return calls


def test_table_does_not_take_the_place_of_what_an_option_file_names(tmp_path, capsys):
    table = tmp_path / "gap.h5"
    table.write_text("heights")
    (tmp_path / "my.opts").write_text(f"-gap_file {table}:/gap  # not {tmp_path / 'other.h5'}")
    path = write(tmp_path, f"option_files: ['{tmp_path / 'my.opts'}']")
    assert main([str(path), "-o", str(table)]) == 2
    assert "is the input" in capsys.readouterr().err and table.read_text() == "heights"
    (other := tmp_path / "other.h5").touch()
    assert main([str(path), "-o", str(other), "--timeout", "1e-3"]) == 3


@pytest.mark.parametrize(
    ("sweep", "output"), [("s.csv", "s.csv"), ("s.csv", "./s.csv"), ("s.runs.jsonl", "s.csv"), ("link.yml", "s.csv")]
)  # fmt: skip
def test_a_sweep_does_not_take_the_place_of_its_own_file(tmp_path, capsys, monkeypatch, sweep, output):
    monkeypatch.chdir(tmp_path)
    text = f"option_files: [{HERTZ}]\noptions: {{grid: 8}}"
    Path("s.csv" if sweep == "link.yml" else sweep).write_text(text)
    Path("link.yml").symlink_to("s.csv")
    before = sorted(Path().iterdir())
    assert main([sweep, "-o", output]) == 2
    assert f"is the input {sweep}; choose another name" in capsys.readouterr().err
    assert sorted(Path().iterdir()) == before and Path(sweep).read_text() == text


def test_interrupted_before_the_first_run_leaves_an_earlier_table(tmp_path, monkeypatch):
    monkeypatch.setattr("app.cli.sweep.run_all", lambda *how, **more: ([None], True))
    output = tmp_path / "out.csv"
    output.write_text("an earlier one")
    assert main([str(write(tmp_path, "options: {grid: 8}")), "-o", str(output)]) == 130
    assert output.read_text() == "an earlier one"


def test_folder_or_journal_that_cannot_be_written(tmp_path, performed, capsys):
    path, output = write(tmp_path, "options: {grid: [8, 16]}"), tmp_path / "out.csv"
    (tmp_path / "out.runs").touch()
    assert main([str(path), "-o", str(output)]) == 2
    assert "error: " in (told := capsys.readouterr().err) and "out.runs: needed" in told
    (tmp_path / "out.runs").unlink()
    with full_disk(10):
        assert main([str(path), "-o", str(output)]) == 2
    assert "out.runs.jsonl: cannot be written: File too large" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_kind_of_table(tmp_path, performed, suffix):
    path = write(tmp_path, "options: {grid: [8, crash], lcp_rtol: [1e-6, 1e-8]}")
    output = tmp_path / f"out{suffix}"
    assert main([str(path), "-o", str(output)]) == 3
    if suffix in (".h5", ".hdf5"):
        with h5py.File(output) as file:
            assert file["lcp_rtol"][()].tolist() == [1e-6, 1e-8, 1e-6, 1e-8]
            assert file["exit_status"][()].tolist() == [0, 0, 1, 1]
    else:
        text = output.read_text()
        assert all(name in text for name in ("grid", "lcp_rtol", "exit_status", *CHECKS))
        assert len([line for line in text.splitlines() if "crash" in line]) == 2


def test_what_is_asked_for_has_a_column(tmp_path):
    path = write(
        tmp_path, f"option_files: [{HERTZ}]\noptions: {{grid: 16, load: 1e4, stiffness: [true, false]}}"
    )
    assert main([str(path), "-o", str(tmp_path / "out.csv")]) == 0
    with (tmp_path / "out.csv").open() as file:
        with_it, without = csv.DictReader(file)
    assert float(with_it["result_stiffness"]) > 1e5 and without["result_stiffness"] == ""
    assert float(with_it["contact_area"]) == pytest.approx(240 * float(with_it["contact_fraction"]))
    assert "stiffness" not in make_rows([Run()], [{"exit_status": 0}])[0]


def test_a_load_path_in_a_sweep_has_a_row_for_each_step(tmp_path, capsys):
    """The numbers of a step are those of the run's own table; work is known of the last one only."""
    output = tmp_path / "out.csv"
    path = write(
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
    assert list(rows[0])[:6] == [
        "sphere_radius",
        "exit_status",
        "step",
        "load",
        "contact_fraction",
        "max_pressure",
    ]
    for run in rows[:3], rows[3:6]:
        table = read_result(run[0]["result"]).path
        for name in (
            "load",
            "approach",
            "indentation",
            "contact_area",
            "max_pressure",
            "mean_contact_pressure",
        ):
            np.testing.assert_allclose([float(row[name]) for row in run], table[name], rtol=1e-12)
        assert [bool(row["solve_seconds"]) for row in run] == [False, False, True]
        assert {row["contact_modulus"] for row in run} == {"100000.0"}
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    panel = sweep_figure(columns).axes[0]
    assert panel.get_xlabel() == "load F  [N]" and [len(line.get_xdata()) for line in panel.lines] == [
        3,
        3,
        0,
    ]


def test_patches_and_estimated_errors_have_columns_where_a_method_knows_them(tmp_path):
    output = tmp_path / "out.csv"
    path = write(
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
