"""The command app.sweep without runs: statuses, tables, bad input."""

from pathlib import Path

import h5py
import pytest
from processes import OPTIONS
from results import full_disk

from app.cli.sweep import SUFFIXES, main
from app.parameter_study import batch
from app.parameter_study.run import CHECKS

HERTZ = OPTIONS / "hertz.opts"


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
    "options: {grid: [[8, [8]]]}": "number or text",
    "options: {grid: 8}\noption_files: [[]]": "empty",
    "options: {grid: 8, Grid: 16}": "Grid: is given twice",
    "options: {output: a.h5}": "output: not allowed",
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


@pytest.mark.parametrize(("statuses", "expected"), [("000", 0), ("222", 2), ("022", 3), ("33", 3), ("2-", 3)])
def test_exit_status_follows_from_the_runs(tmp_path, capsys, monkeypatch, statuses, expected):
    outcomes = iter([{"exit_status": -9 if s == "-" else int(s), "message": s.strip("0")} for s in statuses])
    monkeypatch.setattr(batch, "perform", lambda *how: next(outcomes))
    path = write(tmp_path, f"options: {{grid: [{', '.join('123'[: len(statuses)])}]}}")
    assert main([str(path), "-o", str(tmp_path / "out.csv")]) == expected
    *_, last = lines = capsys.readouterr().out.splitlines()
    assert last.endswith(f"{statuses.count('0')} of {len(statuses)} solved")
    expected = {"222": ["all runs: 2"], "022": ["grid 2; grid 3: 2"]}
    assert statuses not in expected or lines[-2:-1] == expected[statuses]


def test_table_does_not_overwrite_files_named_in_option_files(tmp_path, capsys):
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
def test_table_does_not_overwrite_the_sweep_file(tmp_path, capsys, monkeypatch, sweep, output):
    monkeypatch.chdir(tmp_path)
    text = f"option_files: [{HERTZ}]\noptions: {{grid: 8}}"
    Path("s.csv" if sweep == "link.yml" else sweep).write_text(text)
    Path("link.yml").symlink_to("s.csv")
    before = sorted(Path().iterdir())
    assert main([sweep, "-o", output]) == 2
    assert f"is the input {sweep}; choose another name" in capsys.readouterr().err
    assert sorted(Path().iterdir()) == before and Path(sweep).read_text() == text


def test_interrupt_before_the_first_run_keeps_an_earlier_table(tmp_path, monkeypatch):
    monkeypatch.setattr("app.cli.sweep.run_all", lambda *how, **more: ([None], True))
    output = tmp_path / "out.csv"
    output.write_text("an earlier one")
    assert main([str(write(tmp_path, "options: {grid: 8}")), "-o", str(output)]) == 130
    assert output.read_text() == "an earlier one"


def test_unwritable_folder_or_journal_is_an_error(tmp_path, performed, capsys):
    path, output = write(tmp_path, "options: {grid: [8, 16]}"), tmp_path / "out.csv"
    (tmp_path / "out.runs").touch()
    assert main([str(path), "-o", str(output)]) == 2
    assert "error: " in (told := capsys.readouterr().err) and "out.runs: needed" in told
    (tmp_path / "out.runs").unlink()
    with full_disk(10):
        assert main([str(path), "-o", str(output)]) == 2
    assert "out.runs.jsonl: cannot be written: File too large" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_table_is_written_in_every_format(tmp_path, performed, suffix):
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
