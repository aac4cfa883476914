"""Runs as processes."""

import signal
import sys
import threading
from pathlib import Path
from unittest import mock

import pytest
from processes import OPTIONS

from app.parameter_study import processes
from app.parameter_study.processes import perform, run_command
from app.parameter_study.run import Run

HERTZ = OPTIONS / "hertz.opts"
NORM = OPTIONS / "norm.opts"


def test_simultaneous_serial_runs_share_no_session_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    code = (
        "import os, sys; from mpi4py import MPI; assert MPI.COMM_WORLD.size == 1; "
        f"print(*os.listdir({str(tmp_path)!r}), file=sys.stderr)"
    )
    status, seen = run_command([sys.executable, "-c", code])
    assert status == 0 and set(seen.split()) <= {path.name for path in tmp_path.iterdir()}


def test_hanging_and_crashing_runs_have_an_outcome(tmp_path):
    slow = perform(Run((str(HERTZ), str(NORM))), tmp_path / "a.h5", timeout=0.1)
    assert slow == {"exit_status": 124, "message": "stopped after 0.1 s"}
    refused = perform(Run(options={"absent": "1"}), tmp_path / "a.h5")
    assert refused["exit_status"] == 2 and "-absent" in refused["message"]
    status, errors = run_command([sys.executable, "-c", "import os; os.abort()"])
    assert (status, errors) == (-signal.SIGABRT, "")
    for number, name in ((signal.SIGABRT, "SIGABRT"), (signal.SIGRTMIN + 6, f"signal {signal.SIGRTMIN + 6}")):
        with mock.patch.object(processes, "run_command", return_value=(-number, "")):
            assert perform(Run(), tmp_path / "a.h5")["message"] == f"ended by {name}"
    stop = threading.Event()
    stop.set()
    with pytest.raises(InterruptedError):
        run_command([sys.executable, "-c", "import time; time.sleep(20)"], stop=stop)


def test_interrupt_of_the_caller_ends_the_process(tmp_path):
    """As of `app.verify`, which waits for its ranks itself; a sweep's threads hear of no interrupt."""
    child = tmp_path / "process"
    interrupts = (
        "import os, pathlib, signal, sys, time\n"
        "pathlib.Path(sys.argv[1]).write_text(str(os.getpid()))\n"
        "os.kill(os.getppid(), signal.SIGINT)\n"
        "time.sleep(20)"
    )
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run_command([sys.executable, "-c", interrupts, str(child)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert not Path("/proc", child.read_text()).exists()
