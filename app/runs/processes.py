"""Runs as processes of their own, under mpiexec if need be. Not collective."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading

from app.runs.run import ROOT

# Ranks of several runs must not be bound to the same cores.
_OPEN_MPI = {
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_hwloc_default_binding_policy": "none",  # Open MPI 5
}
# A run without mpiexec needs no daemon of its own; without that, all would have one folder, which one removes while
# another makes it.
_ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}


class Processes:
    """Starts processes from several threads, and ends them all at once."""

    def __init__(self):
        self._running, self._lock, self._closed = set(), threading.Lock(), False

    def call(self, command, timeout=None):
        """Run a command in a process group of its own, so that Ctrl-C reaches only the caller.

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
        """
        environment = {"OMP_NUM_THREADS": "1", **os.environ, **_OPEN_MPI}
        if command[0] != "mpiexec":
            environment |= _ALONE
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        # A file, not a pipe: a daemon that outlives the process would keep a pipe open.
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            with self._lock:
                if self._closed:
                    raise InterruptedError("no more processes are started")
                process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors,
                    env=environment, start_new_session=True,
                )  # fmt: skip
                self._running.add(process)
            try:
                process.wait(timeout)
            except BaseException:  # the time limit, Ctrl-C
                _end(process)
                raise
            finally:
                with self._lock:
                    self._running.discard(process)
            errors.seek(0)
            return process.returncode, errors.read()

    def close(self):
        """End all processes and start no more."""
        with self._lock:
            self._closed = True
            running = list(self._running)
        for process in running:
            _end(process)


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


def perform(run, output, processes, ranks=1, timeout=None):
    """Call the program of a run and collect its outcome; call from any thread.

    Parameters
    ----------
    run : Run
    output : Path
        File the program is to write.
    processes : Processes
    ranks : int
    timeout : float, optional
        [s]

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
        status, errors = processes.call(command, timeout)
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
