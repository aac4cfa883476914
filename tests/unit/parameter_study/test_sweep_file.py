"""Sweep files: combinations of option values."""

from pathlib import Path

import pytest
from processes import FMG, HERTZ, NORM, TESTS, write_sweep

from app.parameter_study.sweep_file import read_sweep

ROOT = TESTS.parent


def combinations(tmp_path, text):
    return [dict(run.options) for run in read_sweep(write_sweep(tmp_path, text))]


def test_combinations_are_ordered_and_keep_values(tmp_path):
    runs = read_sweep(
        write_sweep(tmp_path, "options: {grid: [8, '16,8'], approach: -0.110, lcp_rtol: [1e-6, 1.0e-7]}")
    )
    assert [run.arguments() for run in runs] == [
        ["-grid", grid, "-approach", "-0.110", "-lcp_rtol", rtol]
        for grid in ("8", "16,8")
        for rtol in ("1e-6", "1.0e-7")
    ]
    assert [dict(run.labels) for run in runs] == [
        {"grid": grid, "lcp_rtol": rtol} for grid in (8, "16,8") for rtol in (1e-6, 1e-7)
    ]


def test_names_with_underscores_between_digits_are_no_numbers(tmp_path):
    runs = read_sweep(write_sweep(tmp_path, "options: {surface_file: [2024_01, 2024_02, 2025]}"))
    assert [run.labels["surface_file"] for run in runs] == ["2024_01", "2024_02", 2025]


def test_zip_varies_together_and_a_tilde_omits(tmp_path):
    text = "options: {grid: [8, 16]}\nzip:\n- {ksp_type: [cg, gmres], ksp_gmres_restart: [~, 5]}"
    cg, gmres = {"ksp_type": "cg"}, {"ksp_type": "gmres", "ksp_gmres_restart": "5"}
    assert combinations(tmp_path, text) == [{"grid": n} | pair for n in ("8", "16") for pair in (cg, gmres)]
    assert read_sweep(tmp_path / "sweep.yml")[0].labels["ksp_gmres_restart"] is None


def test_exclude_needs_all_values_and_compares_numbers(tmp_path):
    text = "options: {grid: [8, 16, 32], lcp_beta: [0, 0.003]}\nexclude: [{grid: [16, 32], lcp_beta: 0.0030}]"
    found = combinations(tmp_path, text)
    assert len(found) == 4
    assert {(c["grid"], c["lcp_beta"]) for c in found if c["lcp_beta"] != "0"} == {("8", "0.003")}


def test_empty_value_gives_an_option_without_value(tmp_path):
    (run,) = read_sweep(write_sweep(tmp_path, "options:\n  grid: 8\n  ksp_converged_reason:\n"))
    assert run.arguments() == ["-grid", "8", "-ksp_converged_reason"]


def test_inner_list_is_one_value(tmp_path):
    text = "options: {young: [[210e3, 210e3], [210e3, 3e3]], grid: [8, [16, 8]]}\n"
    text += "exclude: [{grid: [[16, 8]], young: '210e3,3e3'}]"
    assert combinations(tmp_path, text) == [
        {"young": young, "grid": grid}
        for young, grid in (("210e3,210e3", "8"), ("210e3,210e3", "16,8"), ("210e3,3e3", "8"))
    ]


def test_shipped_option_files_are_found_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (run,) = read_sweep(write_sweep(tmp_path, "option_files: [fast.opts, hertz]"))
    assert [Path(file).read_text() for file in run.files] == [
        (ROOT / f"petsc_options/{name}.opts").read_text() for name in ("fast", "hertz")
    ]


def test_alternative_option_files_are_labelled_and_come_before_the_options(tmp_path):
    runs = read_sweep(
        write_sweep(tmp_path, f"option_files: [{HERTZ}, [{NORM}, {FMG}]]\noptions: {{grid: 8}}")
    )
    assert [run.labels for run in runs] == [{"option_files": "norm"}, {"option_files": "fmg_v11"}]
    assert runs[1].arguments() == ["-options_file", str(HERTZ), "-options_file", str(FMG), "-grid", "8"]


@pytest.mark.parametrize(
    "path", sorted((ROOT / "petsc_options/sweeps").glob("*.yml")), ids=lambda path: path.stem
)
def test_shipped_sweeps_are_read(path, monkeypatch):
    monkeypatch.chdir(ROOT)
    runs = read_sweep(path)
    assert len(runs) > 10
    assert len({tuple(run.arguments()) for run in runs}) == len(runs)


def test_option_files_of_one_name_have_different_labels(tmp_path):
    files = [tmp_path / folder / "a.opts" for folder in ("one", "two")]
    for file in files:
        file.parent.mkdir()
        file.touch()
    runs = read_sweep(write_sweep(tmp_path, f"option_files: [['{files[0]}', '{files[1]}', {NORM}]]"))
    assert [run.labels["option_files"] for run in runs] == [*map(str, files), "norm"]
