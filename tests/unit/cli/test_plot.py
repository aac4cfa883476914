"""app.plot: which pictures, of which results, and bad input in one line."""

import numpy as np
import pytest
from mpi4py import MPI
from results import made_up_result, write

from app.api.subsurface import stress, survey
from app.cli import convert, report, subsurface, xdmf
from app.cli.plot import main
from app.cli.sweep import SUFFIXES
from app.io.table import write_table
from app.parallel.slabs import Slabs
from app.plots import load_curves

NAMES = ["contact", "pressure", "deformation", "sections", "distributions", "history", "summary"]
START = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}


@pytest.fixture(scope="module")
def result():
    return made_up_result()


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("result") / "result.h5"
    write(path, MPI.COMM_SELF, Slabs(96), result)
    return path


@pytest.mark.parametrize(
    ("kind", "names"), [("png", NAMES), ("pdf", NAMES[:2]), ("svg", NAMES[:2])], ids=["png", "pdf", "svg"]
)
def test_command_writes_all_figures_and_prints_their_paths(path, tmp_path, capsys, kind, names):
    folder = tmp_path / "new"
    some = [word for name in names for word in ("--only", name)] if names != NAMES else []
    assert main([str(path), "-o", str(folder), "--format", kind, "--dpi", "40", *some]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(folder / f"{name}.{kind}") for name in names]
    assert err == ""
    assert sorted(f.name for f in folder.iterdir()) == sorted(f"{name}.{kind}" for name in names)
    assert all(f.read_bytes().startswith(START[kind]) for f in folder.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_tables_of_sweeps_are_drawn_from_every_format(tmp_path, capsys, suffix):
    names = "load", "young", "exit_status", "approach", "max_pressure", "message"
    rows = [(load, "2e5,3e5", 0, 1e-3 * load**0.67, 900.0 + load, "a|b") for load in (10, 20, 40)]
    write_table(tmp_path / f"out{suffix}", [dict(zip(names, row, strict=True)) for row in rows])
    columns = load_curves.read_columns(tmp_path / f"out{suffix}")
    assert tuple(columns) == names and list(map(float, columns["max_pressure"])) == [910, 920, 940]
    assert columns["message"] == ["a|b"] * 3
    assert main([str(tmp_path / f"out{suffix}"), "-o", str(tmp_path / "pictures"), "--dpi", "30"]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'pictures/sweep.png'}\n"


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".txt", "1 2 4\n--- --- ---\n3 5 9\n"),
        (".md", "| a | b | c |\n|---|---|---|\n| 1 | 2 | 4 |\n| 3 | 5 | 9 |\n"),
        (".md", "| 1 | 2 | 4 |\n| 3 | 5 | 9 |\n"),
    ],
)
def test_texts_of_heights_are_no_tables(tmp_path, capsys, suffix, text):
    (tmp_path / f"s{suffix}").write_text(text)
    assert not load_curves.is_table(tmp_path / f"s{suffix}")
    assert main([str(tmp_path / f"s{suffix}"), "--spacing", "1,1"]) == 2
    assert "--unit is missing: surface file" in capsys.readouterr().err


def test_paper_style_writes_pdf_and_svg_with_the_title_of_the_user(path, tmp_path, capsys):
    words = ["--only", "contact", "--style", "paper", "--title", "Bearing 7", "-o", str(tmp_path / "out")]
    assert main([str(path), *words]) == 0
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["contact.pdf", "contact.svg"]
    text = (tmp_path / "out" / "contact.svg").read_text()
    assert "Bearing 7" in text and 'width="240.94' in text  # 8.5 cm


def test_default_folder_is_named_after_the_file(path, tmp_path, capsys):
    mine = tmp_path / "mine.h5"
    mine.symlink_to(path)
    assert main([str(mine), "--only", "history", "--only", "pressure", "--dpi", "30"]) == 0
    assert sorted(f.name for f in (tmp_path / "mine").iterdir()) == ["history.png", "pressure.png"]
    capsys.readouterr()
    assert main([str(mine), "--only", "path"]) == 2
    assert "--only path: result file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["RESULT", "-o", "DIR", "--only", "contour"], "plot 'contour': must be one of"),
        (["absent.h5", "-o", "DIR"], "absent.h5: no such file"),
        ([__file__, "-o", "DIR"], "not a readable HDF5 file"),
        (["RESULT", "-o", "DIR", "--format", "bmp"], "bmp"),
        (["RESULT", "-o", "DIR", "--dpi", "many"], "--dpi many: must be"),
        (["RESULT", "-o", "DIR", "--dpi", "5"], "--dpi 5: must be a whole number from 20 to 1200"),
        (["RESULT", "-o", "DIR/below"], "does not exist"),
        (["RESULT", "-o", "RESULT"], "not a folder"),
    ],
)
def test_bad_input_is_one_line(path, tmp_path, capsys, arguments, message):
    names = {"RESULT": str(path), "DIR": str(tmp_path / "dir"), "DIR/below": str(tmp_path / "dir" / "below")}
    assert main([names.get(argument, argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert list(tmp_path.iterdir()) == []


def test_several_files_have_folders_and_common_paths(path, tmp_path, capsys):
    sweep, one, two = (tmp_path / name for name in ("sweep.csv", "one.csv", f"{path.stem}.csv"))
    sweep.write_text("grid,exit_status,message,work_units\n32,0,,10\n64,0,,12\n128,2,refused,\n")
    for number, file in enumerate((one, two)):
        file.write_text(f"load,approach,contact_area\n1,0.01,0.1\n{2 + number},0.02,0.2\n")
    out = tmp_path / "out"
    few = ("-o", str(out), "--dpi", "30", "--only", "contact")
    assert main([*map(str, (sweep, one, two, path)), *few]) == 0
    names = ["sweep/sweep.png", "one/path.png", f"{path.stem}_csv/path.png", "paths.png"]
    assert {str(out / name) for name in names} < set(capsys.readouterr().out.splitlines())
    assert (out / f"{path.stem}_h5" / "contact.png").exists()
    assert all((out / name).read_bytes().startswith(START["png"]) for name in names)
    sweep.write_text("\ufeffload,approach\n1,2\n", encoding="utf-8")  # as spreadsheets write it
    assert main([str(sweep), "-o", str(out), "--dpi", "30"]) == 0
    for text, message in (
        ("a,b\n1,2\n", "neither a table"),
        ("grid,exit_status\n32,0\n", "nothing to draw"),
        ("load,approach\na,b\n", "no step has numbers for load and approach"),
    ):
        sweep.write_text(text)
        assert main([str(sweep), "-o", str(out)]) == 2
        assert message in capsys.readouterr().err


def test_columns_are_chosen_for_tables_only(path, tmp_path, capsys):
    sweep, loads, out = tmp_path / "sweep.csv", tmp_path / "loads.csv", tmp_path / "out"
    sweep.write_text("grid,exit_status,message,residual\n32,0,,1e-7\n64,0,,1e-7\n")
    loads.write_text("load,approach,contact_area\n1,0.01,0.1\n2,0.02,0.2\n")
    few = ("-o", str(out), "--dpi", "30")
    for files, words, message in (
        ([sweep], [], "nothing to draw"),
        ([sweep], ["--y", "residual_"], "--y residual_: not a column with numbers; there are grid, "),
        ([loads], ["--y", "gap"], "--y gap: not a column with numbers; there are load, "),
        ([path], ["--y", "load"], f"{path} is none"),
    ):
        assert main([*map(str, files), *words, *few]) == 2
        assert message in capsys.readouterr().err and not out.exists()
    assert main([str(sweep), "--x", "grid", "--y", "residual", *few]) == 0
    assert (out / "sweep.png").is_file()
    assert main([str(loads), "--x", "load", "--y", "contact_area", *few]) == 0
    assert (out / "path.png").is_file()


def test_errors_are_found_before_anything_is_drawn(path, tmp_path, capsys):
    good, bad, out = (tmp_path / name for name in ("good.csv", "bad.csv", "out"))
    good.write_text("load,approach,contact_area\n1,0.01,0.1\n2,0.02,0.2\n")
    bad.write_text("grid,exit_status\n32,0\n")
    for last, only, message in (
        (bad, [], "bad.csv: nothing to draw"),
        (path, ["--only", "path"], "has nothing to draw for it"),
    ):
        assert main([str(good), str(last), "-o", str(out), *only]) == 2
        assert message in capsys.readouterr().err and not out.exists()


def test_files_of_one_name_have_unique_folders(path, tmp_path, capsys):
    """A path and its table, beside each other or in two folders; the same file twice is no use."""
    text, out = "load,approach,contact_area\n1,0.01,0.1\n2,0.02,0.2\n", tmp_path / "out"
    for file in (path.with_suffix(".csv"), tmp_path / "result.csv"):
        file.write_text(text)
    few = ("-o", str(out), "--dpi", "30", "--only", "contact")
    assert main([str(path), str(path.with_suffix(".csv")), *few]) == 0
    assert sorted(found.name for found in out.iterdir()) == ["result_csv", "result_h5"]
    assert main([str(path.with_suffix(".csv")), str(tmp_path / "result.csv"), *few]) == 0
    folders = [path.parent.name, tmp_path.name]
    assert all((out / f"{folder}_result_csv/path.png").is_file() for folder in folders)
    capsys.readouterr()
    assert main([str(path), str(path), "-o", str(out)]) == 2
    assert "two are named result" in capsys.readouterr().err


def test_bug_is_not_reported_as_bad_input(path, tmp_path, monkeypatch):
    monkeypatch.setattr("app.cli.plot._draw_all", lambda arguments: float("of ours"))
    with pytest.raises(ValueError, match="of ours"):
        main([str(path), "-o", str(tmp_path / "out")])


def test_file_of_stresses_is_named_in_the_error(result, tmp_path, capsys):
    subsurface.write(file := tmp_path / "below.h5", result, survey(stress(result), depths=4), {})
    for command in (main, xdmf.main, report.main, subsurface.main):
        assert command([str(file)]) == 2
        said = capsys.readouterr().err
        assert "that app.subsurface wrote, no result; python -m app.subsurface RESULT.h5 -o DIR draws" in said
    assert list(tmp_path.iterdir()) == [file]


def test_measured_surfaces_of_every_format_are_drawn(path, tmp_path, capsys):
    z, out = np.random.default_rng(3).normal(size=(24, 32)), tmp_path / "out"
    np.save(plain := tmp_path / "plain.npy", z)
    np.savetxt(text := tmp_path / "text.csv", z, delimiter=",")
    known, said = tmp_path / "known.h5", ("--unit", "um", "--spacing", "0.001,0.002")
    assert convert.main([str(plain), *said, "-o", str(known)]) == 0
    assert main([str(known), "--dpi", "30"]) == 0
    assert (tmp_path / "known" / "surface.png").read_bytes().startswith(START["png"])
    assert main([str(plain), str(text), *said, "-o", str(out), "--dpi", "30"]) == 0
    assert main([str(path), str(known), "-o", str(out), "--only", "contact", "--dpi", "30"]) == 0
    assert {file.name for file in out.iterdir()} == {"plain", "text", path.stem, "known"}
    capsys.readouterr()
    for words, message in (
        ([plain], f"--unit is missing: surface file {plain}"),
        ([plain, "--unit", "um"], "--spacing is missing"),
        ([known, *said], f"surface file {known} says"),
        ([path, "--spacing", "1,1"], f"{path} is none"),
        ([known, "--x", "load"], f"{known} is none"),
    ):
        assert main([*map(str, words), "-o", str(tmp_path / "not")]) == 2
        assert message in capsys.readouterr().err and not (tmp_path / "not").exists()
    assert report.main([str(known)]) == 2
    assert "heights of a surface, no result; python -m app.plot draws them" in capsys.readouterr().err
