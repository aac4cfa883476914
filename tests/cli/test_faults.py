"""Kills, full and read-only disks, hosts that differ, hostile files: a result is there whole or not at all."""

import os
import random
import signal
import sys
import time

import h5py
import numpy as np
import pytest
from cases import hertz
from processes import TESTS, on_two_hosts, run, solve_arguments
from results import full_disk

from app import ContactSolver
from app.cli import convert, plot, report, subsurface, xdmf
from app.io.files import hash_samples
from app.io.result import read_result

LIMIT = 60  # s
HERTZ = [*solve_arguments("hertz", "norm")[2:], "-grid", "8"]
GAP = "-problem file -domain 0,1,0,1 -approach 2 -shear_modulus 1 -poisson_ratio 0.3".split()


@pytest.fixture(scope="module")
def path_of_two():
    with ContactSolver(hertz(24)) as solver:
        path = solver.path(load=[20000, 40000])
        return path, list(path)


# ------------------------------------------------------------------------------------------------- killed


def start_writing(folder, path, solutions):
    """Fork a process that writes a result and a table over and over; return it as soon as it has begun."""
    reader, writer = os.pipe()
    process = os.fork()
    if not process:
        os.write(writer, b"x")
        while True:
            for solution in solutions:
                solution.save(folder / "result.h5")
                path.save(folder / "path.csv")
    os.read(reader, 1)
    os.close(reader)
    os.close(writer)
    return process


def kill(*processes):
    for process in processes:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


def test_kill_while_writing_leaves_the_old_or_new_file(path_of_two, tmp_path):
    path, solutions = path_of_two
    dice, halves = random.Random(1), 0
    result, table = tmp_path / "result.h5", tmp_path / "path.csv"
    solutions[0].save(result)
    path.save(table)
    rows = table.read_text()
    for _ in range(30):
        process = start_writing(tmp_path, path, solutions)
        time.sleep(dice.uniform(0, 0.05))
        kill(process)
        found = read_result(result)
        wanted = next(s for s in solutions if s.load == found.attributes["load"])
        np.testing.assert_array_equal(found.pressure, wanted.pressure)
        assert table.read_text() == rows
        halves += len(list(tmp_path.iterdir())) > 2
    assert halves  # kills that hit the middle of something
    for left in {*tmp_path.iterdir()} - {result, table}:
        os.utime(left, (0, time.time() - 2 * 86400))
    solutions[0].save(result)
    assert set(tmp_path.iterdir()) == {result, table}


def test_last_of_two_runs_wins_with_a_whole_file(path_of_two, tmp_path):
    """The last whole one stays; none touches what the other is writing."""
    path, solutions = path_of_two
    processes = [start_writing(tmp_path, path, [solution]) for solution in solutions]
    time.sleep(0.5)
    ended = [os.waitpid(process, os.WNOHANG)[0] for process in processes]
    kill(*processes)
    assert ended == [0, 0]
    assert read_result(tmp_path / "result.h5").attributes["load"] in [s.load for s in solutions]


# --------------------------------------------------------------------------------------- disks and folders


@pytest.fixture
def given(path_of_two, tmp_path):
    """Result file and heights that the commands read, in a folder of their own."""
    path, solutions = path_of_two
    folder = tmp_path / "given"
    folder.mkdir()
    solutions[-1].save(folder / "result.h5", path.table)
    np.save(folder / "heights.npy", np.random.default_rng(1).random((40, 50)))
    return folder


WRITERS = {
    "convert": (convert, "heights.npy", "new.h5", ("--unit", "um", "--spacing", "1,1", "-o")),
    "report": (report, "result.h5", "new.html", ("--no-stress", "-o")),
    "subsurface": (subsurface, "result.h5", "", ("-o",)),
    "xdmf": (xdmf, "result.h5", "new.xdmf", ("-o",)),
    "plot": (plot, "result.h5", "", ("--dpi", "20", "-o")),
}


@pytest.mark.parametrize("name", WRITERS)
def test_full_disk_keeps_existing_files(name, given, tmp_path, capsys):
    command, source, target, words = WRITERS[name]
    folder = given if name == "xdmf" else tmp_path / "out"
    folder.mkdir(exist_ok=True)
    (folder / (target or "summary.png")).write_text("an earlier one")
    before = sorted(folder.iterdir())
    with full_disk(1000):
        status = command.main([str(given / source), *words, str(folder / target)])
    out, errors = capsys.readouterr()
    assert (status, len(errors.splitlines())) == (2, 1), out + errors
    assert errors.startswith("error: ")
    assert "File too large" in errors
    assert (folder / (target or "summary.png")).read_text() == "an earlier one"
    assert sorted(folder.iterdir()) == before


VIEWERS = "ksp_view_solution hdf5", "ksp_view_solution binary", "ksp_view_solution ascii", "ksp_view_rhs hdf5"


@pytest.mark.parametrize("viewer", [*VIEWERS, "ksp_view ascii", "ksp_monitor ascii"])
@pytest.mark.parametrize("folder", ["old", "new"])
def test_a_viewer_of_petsc_on_a_full_disk_is_refused(viewer, folder, cli_here, tmp_path):
    name, kind = viewer.split()
    file = tmp_path / "view"
    if folder == "old":
        file.write_text("an earlier one")
    with full_disk(1000):
        done = cli_here("-grid", 16, f"-{name}", f"{kind}:{file}", methods=("hertz", "norm"))
    assert (done.returncode, done.stderr) == (2, f"error: {file}: cannot be written: File too large\n")
    assert file.read_text() == "an earlier one" if folder == "old" else not file.exists()


def test_a_viewer_of_petsc_on_a_full_device_is_refused(cli_here):
    done = cli_here("-grid", 8, "-ksp_view", ":/dev/full", methods=("hertz", "norm"))
    assert (done.returncode, done.stderr) == (
        2, "error: /dev/full: cannot be written: No space left on device\n",
    )  # fmt: skip


SHORT_FILES = """
import resource, runpy, sys
from mpi4py import MPI  # whose own files are larger

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), resource.RLIM_INFINITY))
runpy.run_module("app.solve", run_name="__main__", alter_sys=True)
"""


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("kind", "size"), [("hdf5", 8192), ("binary", 49152), ("ascii", 49152)])
def test_a_disk_that_a_viewer_fills_ends_all_ranks(kind, size, ranks, tmp_path):
    """Full from the start, or after the first of the solves, each of which appends a vector."""
    viewer = "-grid", "64", "-ksp_view_solution", f"{kind}:{tmp_path}/view"
    options = solve_arguments("hertz", "fmg_v11")[2:]
    done = run("-c", SHORT_FILES, size, *options, *viewer, ranks=ranks, timeout=LIMIT)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert (done.returncode, len(errors)) == (2, 1), done.stderr
    assert f"{tmp_path}/view: cannot be written" in errors[0]


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "xdmf"])
def test_read_only_folder_is_refused(name, given, capsys):
    command, source, target, words = WRITERS[name]
    assert command.main([str(given / source), *words, f"/proc/{target}"]) == 2  # not even root may
    errors = capsys.readouterr().err
    assert errors.startswith("error: ")
    assert len(errors.splitlines()) == 1


# ---------------------------------------------------------------------------------------- hosts that differ


@pytest.mark.parametrize("second", [None, pytest.param((9, 9), marks=pytest.mark.slow), "other values"])
def test_inputs_that_differ_between_hosts_are_refused(second, tmp_path):
    folders = tmp_path / "first", tmp_path / "second"
    gap = np.random.default_rng(1).random((8, 8))
    for folder in folders:
        folder.mkdir()
    np.save(folders[0] / "gap.npy", gap)
    if second is not None:
        np.save(folders[1] / "gap.npy", gap[::-1] if isinstance(second, str) else np.ones(second))
    command = "-m", "app.solve", *GAP, "-gap_file", "gap.npy", "-output", tmp_path / "out.h5"
    done = on_two_hosts(folders, *command, timeout=LIMIT)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert (done.returncode, len(errors)) == (2, 1), done.stderr
    assert ("no such file" if second is None else "not the same on all ranks") in errors[0]
    assert not (tmp_path / "out.h5").exists()


def test_files_up_to_4_mib_are_compared_completely(tmp_path):
    path, size = tmp_path / "large", 1 << 22
    path.write_bytes(bytes(size))
    first = hash_samples(path)
    for place in (0, 65_537, size // 2, size - 1):
        with path.open("r+b") as file:
            file.seek(place)
            file.write(b"x")
        assert hash_samples(path) != first
        path.write_bytes(bytes(size))
    assert hash_samples(path) == first
    assert hash_samples(tmp_path / "absent") is None


@pytest.mark.parametrize("most", [640_000, 720_000, 800_000])
def test_rank_without_address_space_does_not_deadlock_the_other(most):
    """OpenBLAS tries for ever to allocate what it may not have."""
    script = f'if [ "$OMPI_COMM_WORLD_RANK" = 1 ]; then ulimit -v {most}; fi; exec "$@"'
    done = run(
        "-c", script, "sh", sys.executable, "-m", "app.solve", *HERTZ, ranks=2, program="sh", timeout=LIMIT
    )
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert (done.returncode, len(errors)) in ((0, 0), (2, 1)), done.stderr
    assert all("ulimit -v" in line for line in errors)


# ----------------------------------------------------------------------------------------- hostile files


@pytest.fixture
def hostile(given):
    """``hostile(name, values)``: result file in which a dataset, or an attribute @name, is something else."""

    def change(name, values):
        with h5py.File(given / "result.h5", "r+") as file:
            if name.startswith("@"):
                file.attrs[name[1:]] = values
            else:
                del file[name]
                if isinstance(values, dict):
                    file.create_dataset(name, **values)
                elif values is not None:
                    file[name] = values
        return given / "result.h5"

    return change


BOMB = {"shape": (1 << 20, 1 << 20), "dtype": "f8", "chunks": (1024, 1024), "compression": "gzip"}


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("pressure", "text", "dataset pressure: type object"),
        ("pressure", h5py.Empty("f8"), "dataset pressure: type float64, shape None"),
        ("pressure", np.ones((3, 3), complex), "dataset pressure: type complex128"),
        ("pressure", h5py.SoftLink("/nowhere"), "dataset pressure"),
        ("gap", BOMB, "GiB of memory"),
        ("x", 1.0, "dataset x: shape ()"),
        ("x", np.zeros(0), "dataset x: shape (0,)"),
        ("history/level", np.zeros((2, 2), int), "columns of shapes"),
        ("path/load", h5py.SoftLink("/nowhere"), "dataset path/load is missing"),
        ("path/load", np.zeros(5), "columns of shapes"),
        ("@load", "much", "attribute load: 'much'"),
        ("@load", h5py.Empty("f8"), "attribute load: "),
        ("@reason", 3.0, "attribute reason: 3.0"),
        ("@young", "steel", "attribute young: 'steel'"),
    ],
)
def test_result_with_wrong_types_is_refused(hostile, name, values, message, capsys):
    path = hostile(name, values)
    with pytest.raises(ValueError, match=r"result\.h5: ") as refusal:
        read_result(path)
    assert message in str(refusal.value)
    assert subsurface.main([str(path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("command", [convert, plot, report, subsurface, xdmf])
@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_pipes_and_folders_are_not_read(command, make, tmp_path, capsys):
    path = tmp_path / "strange.h5"
    make(path)
    target = tmp_path / ("out.xdmf" if command is xdmf else "out.html" if command is report else "out.h5")
    assert command.main([str(path), "-o", str(target)]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("error: ")
    assert len(errors.splitlines()) == 1


def test_pipe_as_gap_or_result_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    for words in ([*HERTZ, "-output", "pipe.h5"], [*GAP, "-gap_file", "pipe.h5"]):
        done = run(
            "-m", "app.solve", *words, cwd=tmp_path, env={"PYTHONPATH": str(TESTS.parent)}, timeout=LIMIT
        )
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
        assert "not a" in done.stderr
