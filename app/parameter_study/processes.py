"""Runs as processes of their own, under mpiexec if need be. Not collective."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress

from app.parameter_study.run import ROOT

# Ranks of several runs must not be bound to the same cores.
_OPEN_MPI = {
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_hwloc_default_binding_policy": "none",  # Open MPI 5
}
_GLANCE = 0.5  # s between looks at the event that stops a process
# A run without mpiexec needs no daemon of Open MPI. At the end of each run, version 4 would then remove a folder that
# all runs share; version 5 removes each run's own only.
_ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}


def run_command(command, timeout=None, stop=None):
    """Run a command in a process group of its own, so that Ctrl-C reaches only the caller.

    Parameters
    ----------
    command : sequence of str
    timeout : float, optional
        [s]
    stop : threading.Event, optional
        Ends the process when it is set, by another thread.

    Returns
    -------
    status : int
        Exit status; minus the signal that ended it.
    errors : str
        What it said on standard error.

    Raises
    ------
    subprocess.TimeoutExpired
        After `timeout` seconds; the process is gone then.
    InterruptedError
        If it was stopped.
    """
    environment = {"OMP_NUM_THREADS": "1", **os.environ, **_OPEN_MPI}
    if command[0] != "mpiexec":
        environment |= _ALONE
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    deadline = time.monotonic() + (timeout or math.inf)
    # A file, not a pipe: a daemon that outlives the process would keep a pipe open.
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, env=environment,
            start_new_session=True,
        )  # fmt: skip
        try:
            while process.poll() is None:
                if stop is not None and stop.is_set():
                    raise InterruptedError("stopped")
                if (left := deadline - time.monotonic()) <= 0:
                    raise subprocess.TimeoutExpired(command, timeout)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(min(left, _GLANCE))
        except BaseException:  # the time limit, Ctrl-C
            _end(process)
            raise
        errors.seek(0)
        return process.returncode, errors.read()


def _end(process):
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(3)
            return
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def perform(run, output, stop=None, ranks=1, timeout=None):
    """Call the program of a run and collect its outcome; call from any thread.

    Parameters
    ----------
    run : Run
    output : Path
        File the program is to write.
    stop, timeout
        See `call`.
    ranks : int

    Returns
    -------
    dict
        `exit_status`, `message` (empty, warnings, or what went wrong), and what ``run.collect`` returns.
    """
    command = [sys.executable, "-P", "-m", run.module, *run.arguments(), "-output", str(output)]
    if ranks > 1:
        command = ["mpiexec", "-n", str(ranks), *command]
    output.unlink(missing_ok=True)
    try:
        status, errors = run_command(command, timeout, stop)
    except subprocess.TimeoutExpired:
        return {"exit_status": 124, "message": f"stopped after {timeout:g} s"}
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    outcome = {"exit_status": status, "message": " | ".join(x for x in lines if x.startswith("warning: "))}
    if status in (0, 3) and output.is_file():
        try:
            outcome |= run.collect(output)
        except (ValueError, OSError) as error:
            outcome["message"] = str(error)
        if status == 3:
            why = outcome.get("reason") or "not converged"
            if outcome.get("converged"):  # it says nothing of what came before
                why = "a step of the path is not solved, or -refine_max was reached first"
            outcome["message"] = ". ".join(filter(None, (why, outcome["message"])))
    else:
        told = [line for line in lines if line.startswith("error: ")] or lines or ["no result file"]
        outcome["message"] = told[-1] if status >= 0 else f"ended by {_name_of_signal(-status)}"
    return outcome


def _name_of_signal(number):
    known = {known.value: known.name for known in signal.Signals}
    return known.get(number, f"signal {number}")  # those of real time have no names
