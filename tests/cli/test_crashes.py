"""Crashes, signals and readers that go away: nothing hangs, no result is half there."""

import os
import shlex
import signal
import subprocess
import sys
import time

import pytest
from processes import TESTS, solve_arguments

from app.io.result import read_result

RESULT = "result.h5"
COMMAND = [*solve_arguments("hertz", "norm"), "-grid", "8"]
FAULTY = ["-grid", "16", "-ksp_type", "cg", "-pc_type", "python", "-pc_python_type"]


@pytest.mark.ranks(1, 2, 3)
def test_exception_on_one_rank_ends_the_job_with_its_traceback(cli, ranks, tmp_path):
    path = tmp_path / RESULT
    path.write_bytes(b"an earlier result")
    done = cli(
        *FAULTY, "faults.RaisesOnLastRank", "-output", path,
        methods=["hertz"], ranks=ranks, env={"PYTHONPATH": str(TESTS)},
    )  # fmt: skip
    assert done.returncode not in (0, 2, 3)
    [line] = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    where = f"rank {ranks - 1}: " if ranks > 1 else ""
    assert line == f"error: {where}RuntimeError: this rank has a problem of its own"
    assert done.stderr.count("Traceback") == 1
    assert "Segmentation" not in done.stderr
    assert path.read_bytes() == b"an earlier result"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("ranks", "word"),
    [
        (None, signal.SIGKILL),
        (None, signal.SIGTERM),
        (None, signal.SIGHUP),
        (2, signal.SIGTERM),
        (2, signal.SIGINT),
    ],
)
def test_signal_keeps_the_previous_result(cli, ranks, word, tmp_path):
    """Ctrl-C on one rank is below."""
    path, begun = tmp_path / RESULT, tmp_path / "begun"
    assert cli("-grid", 16, "-output", path, methods=["hertz", "norm"]).returncode == 0
    before = path.read_bytes()
    python = [sys.executable, *solve_arguments("hertz"), *FAULTY, "faults.TakesForEver", "-output", str(path)]
    process = subprocess.Popen(
        python if ranks is None else ["mpiexec", "-n", str(ranks), *python],
        env={**os.environ, "PYTHONPATH": str(TESTS), "SOLVE_HAS_BEGUN": str(begun)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),  # as without nohup
    )
    try:
        deadline = time.monotonic() + 60
        while not begun.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        assert begun.exists()
    finally:
        process.send_signal(word)
        process.wait(timeout=60)
    assert process.returncode not in (0, 2, 3)
    assert ranks or process.returncode == -word
    begun.unlink()
    assert path.read_bytes() == before
    assert read_result(path).attributes["converged"] is True
    assert list(tmp_path.iterdir()) == [path]


def test_closed_pipe_does_not_stop_a_run(tmp_path):
    """A closed pipe is no crash, and what was asked for is still written."""
    out = tmp_path / "out.h5"
    command = shlex.join([sys.executable, *COMMAND, "-output", str(out)])
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command} -lcp_monitor | head -1"],
        cwd=TESTS.parent, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.stdout.startswith("level")
    assert done.stderr == ""
    assert done.returncode == 0
    assert read_result(out).attributes["converged"]


def test_interrupted_run_has_status_130(tmp_path):
    """Ctrl-C: one line, status 130, no file."""
    out = tmp_path / "out.h5"
    slow = "-grid 512 -lcp_rtol 1e-14 -lcp_max_it 100000 -ksp_rtol 1e-15 -lcp_monitor".split()
    process = subprocess.Popen(
        [sys.executable, *COMMAND, *slow, "-output", str(out)],
        cwd=TESTS.parent, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout.readline().startswith("level")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "interrupted\n"
    assert list(tmp_path.iterdir()) == []
