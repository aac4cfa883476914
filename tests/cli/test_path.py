"""Load paths and refinement from outside: interrupted and resumed, on ranks, what is written, exit status."""

import csv
import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from processes import OPTIONS

from app.base.errors import InputError
from app.cli import option_sources
from app.cli.problem_options import Request
from app.io.result import read_result

HERTZ = ("-options_file", OPTIONS / "hertz.opts", "-grid", 32)
PATH = (*HERTZ, "-load_path", "1000:80000:4:log")


def table(path):
    """Columns of a CSV."""
    rows = list(csv.DictReader(path.open()))
    return {name: [row[name] for row in rows] for name in rows[0]}


def test_each_step_prints_the_prescribed_quantity_first(cli_here):
    for kind, said in (
        ("mean_pressure", "mean pressure 10 N/mm2, load 2400 N, "),
        ("load", "load 10 N, approach "),
    ):
        done = cli_here(*HERTZ[:-1], 16, "-domain", "-10,10,-6,6", f"-{kind}_path", "10,20")
        assert f"step 1 of 2: {said}" in done.stdout


def test_interrupted_and_resumed_path_gives_the_identical_table(cli_here, tmp_path):
    whole, broken = tmp_path / "whole.h5", tmp_path / "broken.h5"
    assert cli_here(*PATH, "-path_fields", "-output", whole).returncode == 0
    in_the_way = tmp_path / "broken_0003.h5"
    in_the_way.mkdir()
    stopped = cli_here(*PATH, "-path_fields", "-output", broken)
    assert stopped.returncode == 2
    assert "note: 2 of 4 steps are stored in " in stopped.stderr
    assert not broken.exists()
    first, kept = tmp_path / "broken_0001.h5", tmp_path / "kept.h5"
    first.rename(kept)
    first.mkdir()
    anew = cli_here(*PATH, "-path_fields", "-output", broken)
    assert "warning: " in anew.stderr and "replaces 2 steps of an interrupted run" in anew.stderr
    for folder in (in_the_way, first):
        folder.rmdir()
    kept.rename(first)
    other = cli_here(*PATH, "-path_fields", "-output", broken, "-resume", "-poisson_ratio", "0.3")
    assert other.returncode == 2
    assert "is of a run with other options" in other.stderr
    resumed = cli_here(*PATH, "-path_fields", "-output", broken, "-resume")
    assert resumed.returncode == 0, resumed.stderr
    assert "2 of 4 steps are done already" in resumed.stdout
    assert broken.with_suffix(".csv").read_bytes() == whole.with_suffix(".csv").read_bytes()
    assert not list(tmp_path.glob("*.jsonl"))
    steps = [read_result(tmp_path / f"broken_{step:04d}.h5").attributes["load"] for step in (1, 2, 3, 4)]
    assert steps == pytest.approx(np.geomspace(1000, 80000, 4))
    one, other = read_result(whole), read_result(broken)
    assert np.array_equal(one.pressure, other.pressure)
    assert one.path.keys() == other.path.keys() == table(whole.with_suffix(".csv")).keys()
    assert one.path["load"] == pytest.approx(steps)
    nothing = cli_here(*PATH, "-path_csv", tmp_path / "other.csv", "-resume")
    assert nothing.returncode == 0 and "note: -resume: nothing to continue" in nothing.stderr
    assert one.attributes["load"] == pytest.approx(80000)
    assert one.attributes["contact_patches"] == 1


@pytest.mark.parametrize("done", [1, 2, 3])
def test_unloading_path_is_resumed_from_the_indented_shape(cli_here, tmp_path, done):
    words = (*HERTZ, "-hardness", "1000", "-load_path", "5e4:9e4:2,3e4:0:2,9.5e4", "-path_fields")
    whole, broken = tmp_path / "whole.h5", tmp_path / "broken.h5"
    assert cli_here(*words, "-output", whole).returncode == 0
    in_the_way = tmp_path / f"broken_{done + 1:04d}.h5"
    in_the_way.mkdir()
    assert cli_here(*words, "-output", broken).returncode == 2
    in_the_way.rmdir()
    assert cli_here(*words, "-output", broken, "-resume").returncode == 0
    assert broken.with_suffix(".csv").read_bytes() == whole.with_suffix(".csv").read_bytes()
    path = read_result(broken).path
    assert list(path["load"]) == pytest.approx([5e4, 9e4, 3e4, 0, 9.5e4])
    assert path["plastic_volume"][3] == pytest.approx(path["plastic_volume"][1], rel=1e-12)
    assert path["indentation"][3] > 0 and path["max_pressure"][2] < 1000 == path["max_pressure"][4]
    unloaded, expected = (read_result(tmp_path / f"{name}_0004.h5") for name in ("broken", "whole"))
    assert np.array_equal(unloaded.plastic_depth, expected.plastic_depth) and unloaded.plastic_depth.any()


def test_resume_after_a_full_disk_keeps_all_steps(cli_here, tmp_path, monkeypatch):
    def refuse(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    words = (*PATH, "-output", tmp_path / "path.h5")
    with monkeypatch.context() as patch:
        patch.setattr(os, "posix_fallocate", refuse)
        full = cli_here(*words)
    assert full.returncode == 2 and "No space left on device" in full.stderr
    assert (
        f"note: 4 of 4 steps are stored in {tmp_path / 'path.path.jsonl'}; -resume continues" in full.stderr
    )
    found = (tmp_path / "path.csv").read_bytes()
    done = cli_here(*words, "-resume")
    assert done.returncode == 0 and "kept" not in done.stderr
    assert (tmp_path / "path.csv").read_bytes() == found
    assert sorted(path.name for path in tmp_path.iterdir()) == ["path.csv", "path.h5"]


def test_notes_come_back_with_resumed_steps(cli_here, tmp_path):
    """Steps 1 and 2 touch few cells and say so, whether they are solved in this run or were in the one before."""
    few = (*HERTZ, "-load_path", "0.01,0.02,8e4,9e4", "-path_fields")
    whole, broken = tmp_path / "whole.h5", tmp_path / "broken.h5"
    expected = cli_here(*few, "-output", whole).stderr
    assert "steps 1, 2: contact is " in expected
    (tmp_path / "broken_0003.h5").mkdir()
    assert cli_here(*few, "-output", broken).returncode == 2
    (tmp_path / "broken_0003.h5").rmdir()
    assert cli_here(*few, "-output", broken, "-resume").stderr == expected
    assert read_result(broken).attributes["notes"] == read_result(whole).attributes["notes"]


def test_resume_repeats_steps_without_their_file(cli_here, tmp_path):
    (tmp_path / "a_0003.h5").mkdir()
    assert cli_here(*PATH, "-path_fields", "-output", tmp_path / "a.h5").returncode == 2
    for file in ("a_0002.h5", "a_0003.h5"):
        path = tmp_path / file
        path.rmdir() if path.is_dir() else path.unlink()
    resumed = cli_here(*PATH, "-path_fields", "-output", tmp_path / "a.h5", "-resume")
    assert "1 of 4 steps are done already" in resumed.stdout
    assert "a_0002.h5; step 2 of 4 comes first" in resumed.stderr
    assert len(list(tmp_path.glob("a_*.h5"))) == 4


def test_resume_refuses_another_module(cli, tmp_path):
    module = tmp_path / "mine.py"
    module.write_text("def bump(x, y):\n    return (x**2 + y**2) / 40\n")
    words = "-problem python -problem_type mine.bump -domain -1,1,-1,1 -grid 16 -contact_modulus 1e5"
    words = (*words.split(), "-load_path", "10,20,30", "-path_fields", "-output", "a.h5")
    (tmp_path / "a_0002.h5").mkdir()
    assert cli(*words, cwd=tmp_path).returncode == 2
    (tmp_path / "a_0002.h5").rmdir()
    module.write_text("def bump(x, y):\n    return (x**2 + y**2) / 20\n")
    resumed = cli(*words, "-resume", cwd=tmp_path)
    assert resumed.returncode == 2 and "is of a run with other options" in resumed.stderr


@pytest.mark.ranks(2)
def test_rank_0_writes_the_table_of_a_path(cli, tmp_path, ranks):
    constants = "-resistivity", "1e-7,2e-7"
    done = cli(*PATH, "-path_csv", tmp_path / "a.csv", "-stiffness", *constants, ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("step ") == 4
    columns = table(tmp_path / "a.csv")
    assert [float(load) for load in columns["load"]] == pytest.approx(np.geomspace(1000, 80000, 4))
    assert set(columns["converged"]) == {"True"}
    widths, conductances = (
        np.array(columns[name], float) for name in ("conductance_width", "electrical_conductance")
    )
    assert conductances == pytest.approx(2e-3 * widths / 3e-7)
    assert float(columns["stiffness"][1]) == pytest.approx(
        float(columns["stiffness_by_differences"][1]), rel=0.1
    )


def test_unsolved_step_gives_status_3(cli_here, tmp_path):
    options = ("-options_file", OPTIONS / "norm.opts", "-lcp_max_it", 1)
    failed = cli_here(*HERTZ, *options, "-approach_path", "0.1,-1", "-output", tmp_path / "a.h5")
    assert failed.returncode == 3
    assert "step 1 NOT CONVERGED" in failed.stdout
    assert list(read_result(tmp_path / "a.h5").path["converged"]) == [False, True]


def test_resume_and_step_files_need_an_output(cli_here):
    for option in ("-resume", "-path_fields"):
        refused = cli_here(*PATH, option)
        assert refused.returncode == 2
        assert "-output" in refused.stderr


@pytest.mark.parametrize(
    ("gap", "options"),
    [
        ("a.csv", ()),
        ("b.csv", ("-path_csv", "b.csv")),
        ("a_0002.h5", ("-path_fields",)),
        ("a_0003.h5:/gap", ("-path_fields",)),
    ],
)
def test_files_of_a_path_do_not_overwrite_its_inputs(tmp_path, monkeypatch, gap, options):
    monkeypatch.chdir(tmp_path)
    file = Path(gap.partition(":")[0])
    if file.suffix == ".csv":
        np.savetxt(file, np.ones((4, 4)), delimiter=";")
    else:
        with h5py.File(file, "w") as h5:
            h5["gap"] = np.ones((4, 4))
    words = f"-problem file -gap_file {gap} -domain 0,1,0,1 -contact_modulus 1 -load_path 1:3:3 -output a.h5"
    given = option_sources.parse_options(["app.solve", *words.split(), *options])
    with pytest.raises(InputError, match=f"{file.name}: is the input .*; choose another name"):
        Request(given, MPI.COMM_SELF)


def test_refinement_stops_below_the_error(cli_here, tmp_path):
    output = "-thermal_conductivity", "45,45", "-stiffness", "-output", tmp_path / "a.h5"
    fine = cli_here(*HERTZ, "-refine_until", "0.02", *output)
    assert fine.returncode == 0, fine.stderr
    assert "is below 0.02" in fine.stdout
    result = read_result(tmp_path / "a.h5")
    assert result.pressure.shape[0] > 32
    grids = sum(line.endswith("True") for line in fine.stdout.splitlines())
    assert result.attributes["refinement_nx"] == [32 * 2**k for k in range(grids)]
    assert result.attributes["refinement_load"][-1] == result.load
    assert 0 < result.attributes["load_error"] < result.attributes["contact_area_error"] <= 0.02
    assert result.attributes["stiffness"] == pytest.approx(result.attributes["analytic_stiffness"], rel=0.02)
    assert result.attributes["thermal_conductance"] == pytest.approx(
        45e-3 * result.attributes["conductance_width"]
    )
    assert f"thermal conductance {result.attributes['thermal_conductance']:.6g} W/K" in fine.stdout
    alone = cli_here(*HERTZ, "-load", "1e4", "-resistivity", "1e-7,1e-7")
    assert alone.returncode == 2 and "-resistivity: has no effect here" in alone.stderr
    coarse = cli_here(*HERTZ, "-refine_until", "0.001", "-refine_max", 2000, "-output", tmp_path / "b.h5")
    assert coarse.returncode == 3
    assert "is NOT below 0.001" in coarse.stdout
    assert "errors are still above 0.001" in read_result(tmp_path / "b.h5").attributes["notes"]
