"""Commands run from outside. Nothing of app/ is needed here."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parent
OPTIONS = TESTS.parent / "petsc_options"
HERTZ, NORM, FMG = (OPTIONS / f"{name}.opts" for name in ("hertz", "norm", "fmg_v11"))


def run(*command, ranks=None, timeout=60, env=None, cwd=None, program=sys.executable):
    """Run ``python command``, under mpiexec if `ranks` is given; return status and output as text."""
    line = [str(program), *map(str, command)]
    if ranks is not None:
        line = ["mpiexec", "-n", str(ranks), *line]
    process = subprocess.Popen(
        line,
        env={**os.environ, **(env or {})},  # Open MPI's own variables, if we run under it, must go along
        cwd=cwd or TESTS.parent,
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.terminate()  # lets mpiexec end its ranks
        out, err = process.communicate(timeout=20)
        raise AssertionError(f"hangs for {timeout} s: {' '.join(line)}\n{out}\n{err}") from None
    except BaseException:  # the time limit of pytest, Ctrl-C
        process.terminate()
        process.wait()
        raise
    return subprocess.CompletedProcess(line, process.returncode, out, err)


def on_two_hosts(folders, *command, **how):
    """Run ``python command`` on two ranks, each in a folder of its own, as if they were on two hosts; see `run`."""
    script = 'if [ "$OMPI_COMM_WORLD_RANK" = 0 ]; then cd "$1"; else cd "$2"; fi; shift 2; exec "$@"'
    return run("-c", script, "sh", *folders, sys.executable, *command, ranks=2, program="sh", **how)


def solve_arguments(*methods):
    """Arguments of python for app.solve with these option files of the project."""
    files = [argument for name in methods for argument in ("-options_file", str(OPTIONS / f"{name}.opts"))]
    return ["-m", "app.solve", *files]


def write_sweep(folder, text):
    """Write a sweep file to a folder; return its path."""
    path = folder / "sweep.yml"
    path.write_text(text)
    return path
