"""Commands that are started, and what they say when they fail."""

import os
import subprocess
import sys


def capture(command, **options):
    """Run a command and return it with its exit status and output.

    The environment is Python's: Open MPI, loaded here, adds to that of the process what stops `mpiexec`.
    """
    options = {"env": dict(os.environ), "capture_output": True, "text": True, "check": False} | options
    return subprocess.run([*map(str, command)], **options)


def reason(done):
    """Return the last line of a failed command that names an error, else its last line."""
    lines = (done.stderr + done.stdout).strip().splitlines() or [f"exit status {done.returncode}"]
    return next((line.strip() for line in reversed(lines) if "error" in line.lower()), lines[-1].strip())


def say(text):
    """Print a line of progress."""
    print(f"[peers] {text}", file=sys.stderr, flush=True)
