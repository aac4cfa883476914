"""Runs as separate processes, with mpiexec for several ranks."""

import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress

from app.base.mpi import SINGLE_RANK
from app.parameter_study.run import ROOT, collect_result

# Ranks of simultaneous runs must not be bound to the same cores.
_OPEN_MPI = {
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_hwloc_default_binding_policy": "none",  # Open MPI 5
}
_POLL_INTERVAL = 0.5  # s, between checks of the stop event
_KILL_DELAY = 3  # s, from SIGTERM to SIGKILL


def run_command(command, timeout=None, stop=None):
    """Run a command; return exit status and standard error.

    The process has a process group of its own. After `timeout` [s] the process is ended, and TimeoutExpired is raised.
    If the event `stop` is set, the process is ended, and InterruptedError is raised. If a signal ended the process, the
    status is minus the number of the signal.
    """
    environment = {"OMP_NUM_THREADS": "1", **os.environ, **_OPEN_MPI}
    environment |= SINGLE_RANK if command[0] != "mpiexec" else {}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    deadline = time.monotonic() + (timeout or math.inf)
    # A file, because a daemon that outlives the process would keep a pipe open.
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, env=environment,
            start_new_session=True,
        )  # fmt: skip
        try:
            while process.poll() is None:
                if stop is not None and stop.is_set():
                    raise InterruptedError("stopped")
                if (remaining := deadline - time.monotonic()) <= 0:
                    raise subprocess.TimeoutExpired(command, timeout)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(min(remaining, _POLL_INTERVAL))
        except BaseException:
            for number in (signal.SIGTERM, signal.SIGKILL):
                with suppress(ProcessLookupError, subprocess.TimeoutExpired):
                    os.killpg(process.pid, number)
                    process.wait(_KILL_DELAY)
                    break
            raise
        errors.seek(0)
        return process.returncode, errors.read()


def perform(run, output, stop=None, ranks=1, timeout=None):
    """Run app.solve with the options of a `Run` and return its outcome, a dict.

    The outcome has `exit_status`, `message` (warnings or error), and what `collect_result` returns.
    """
    command = ["mpiexec", "-n", str(ranks)] if ranks > 1 else []
    command += [sys.executable, "-P", "-m", "app.solve", *run.arguments(), "-output", str(output)]
    output.unlink(missing_ok=True)
    try:
        status, errors = run_command(command, timeout, stop)
    except subprocess.TimeoutExpired:
        return {"exit_status": 124, "message": f"stopped after {timeout:g} s"}
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if status < 0:
        names = {known.value: known.name for known in signal.Signals}  # real-time signals have none
        return {"exit_status": status, "message": f"ended by {names.get(-status, f'signal {-status}')}"}
    if status not in (0, 3) or not output.is_file():
        errors = [line for line in lines if line.startswith("error: ")] or lines or ["no result file"]
        return {"exit_status": status, "message": errors[-1]}
    outcome = {"exit_status": status, "message": " | ".join(x for x in lines if x.startswith("warning: "))}
    try:
        outcome |= collect_result(output)
    except (ValueError, OSError) as error:
        outcome["message"] = str(error)
    if status == 3:
        reason = outcome.get("reason") or "not converged"
        if outcome.get("converged"):  # the last step or grid is
            reason = "a step of the path is not solved, or -refine_max was reached first"
        outcome["message"] = ". ".join(filter(None, (reason, outcome["message"])))
    return outcome
