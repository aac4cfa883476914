"""Keys of runs."""

from pathlib import Path

import pytest

from app.parameter_study.run import Run


@pytest.mark.parametrize("option", ["gap_file", "any_option_that_names_a_file"])
@pytest.mark.parametrize("inside", ["", ":/dataset", ":Name"])
def test_key_follows_options_and_files_but_not_labels(tmp_path, option, inside):
    file = tmp_path / "file"
    file.write_text("before")
    named = {option: f"{file}{inside}"}
    run = Run((), named)
    before = run.key()
    assert Run((), named, {"a": 1}).key() == before
    assert Run((), {**named, "grid": "8"}).key() != before
    file.write_text("after")
    assert run.key() != before


@pytest.mark.parametrize(
    "options",
    [
        {"my.opts": "-gap_file gap.npy # heights"},
        {"my.opts": '-gap_file "gap.npy:/a"'},
        {"my.opts": '-gap_file "a gap.npy"'},
        {"my.opts": '-options_file "other one.opts"', "other one.opts": "-gap_file gap.npy"},
        {"my.yml": "---\ngap_file: a gap.npy"},
        {".petscrc": "-gap_file gap.npy"},
        {"petscrc": ""},
        {"mine.py": ""},
    ],
)
def test_key_follows_what_option_files_name(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    for name, text in options.items():
        Path(name).write_text(text)
    files = tuple(name for name in options if name.startswith("my"))
    run = Run(files, {"problem_type": "mine.Bump"})
    for changed in {"gap.npy", "a gap.npy", *options}:
        Path(changed).touch()
    before = run.key()
    for changed in ("gap.npy", "a gap.npy"):
        Path(changed).write_text("after")
    for name in set(options) & {"petscrc", "mine.py"}:
        Path(name).write_text("after")
    assert run.key() != before


def test_key_takes_any_value():
    assert Run((), {"gap_file": "a" * 5000}).key() != Run((), {"gap_file": "/"}).key()
