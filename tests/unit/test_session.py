"""How a command starts MPI, and how those without it end."""

import os
import platform
import signal
import subprocess
import sys
from importlib import import_module
from unittest import mock

import pytest
from processes import TESTS

from app import __version__
from app.base.errors import InputError
from app.cli import session, streams

FAULTS = """
import os, resource, sys
from app.cli.session import keep_freed_pages
keep_freed_pages(os.environ)
text = sys.argv[1] * 20_000_000
del text
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
text = sys.argv[1] * 20_000_000
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another malloc")
@pytest.mark.parametrize("asked", [{}, {"MALLOC_MMAP_THRESHOLD_": "131072"}])
def test_what_is_freed_keeps_its_pages_unless_the_environment_says_otherwise(asked):
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    found = subprocess.run(
        [sys.executable, "-c", FAULTS, "x"], env=plain | asked, capture_output=True, text=True, check=True
    )
    assert (int(found.stdout) > 1000) == bool(asked)  # 20 MB are 4883 pages


STATE = """
import os, re, signal, sys
from app.base import memory
calls, chosen = [], []

class Finder:
    def find_spec(name, path=None, target=None):
        if name == "mpi4py.MPI":
            chosen.append(os.environ.get("OMPI_MCA_pml"))

sys.meta_path.insert(0, Finder)
memory.set_malloc_option = lambda *words: calls.append(words)

def state():
    status = open("/proc/self/status").read()
    pipe = [int(mask, 16) >> signal.SIGPIPE - 1 & 1 for mask in re.findall("Sig(?:Ign|Cgt):(.*)", status)]
    return pipe, signal.getsignal(signal.SIGPIPE), sys.excepthook, dict(os.environ), list(calls)

signal.signal(signal.SIGPIPE, getattr(signal, sys.argv[1]))
before = state()
import app.api.analytic_values, app.api.load_path, app.api.refinement, app.api.solver, app.cli.subsurface
from app import *
assert state() == before, (before, state())
print(*chosen)
"""


@pytest.mark.parametrize("ignored", ["SIG_IGN", "SIG_DFL"])
def test_to_import_the_library_changes_nothing_of_the_process(ignored):
    """Open MPI does not look for networks, as in a command."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMI"))}
    command = [sys.executable, "-c", STATE, ignored]
    done = subprocess.run(command, env=plain, cwd=TESTS.parent, capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()) == (0, ["ob1"]), done.stderr


@pytest.mark.parametrize("name", "convert plot report reproduce subsurface sweep verify xdmf".split())
@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt, 130, ""),
        (InputError("no\nway"), 2, "error: no way\n"),
        (OSError(28, "No space left on device"), 2, "error: [Errno 28] No space left on device\n"),
        (MemoryError("17 GiB"), 2, "error: 17 GiB\n"),
        (InputError("unit= (-surface_unit) is missing"), 2, "error: -surface_unit is missing\n"),
        (
            InputError("by skip=2 (-skip 2, x --skip 2), or nu= (--nu X)"),
            2,
            "error: by -skip 2, x --skip 2, or --nu X\n",
        ),
        (InputError("a=b is no (- option)"), 2, "error: a=b is no (- option)\n"),
    ],
)
def test_commands_of_the_shell_end_alike(name, error, status, line, monkeypatch, capsys):
    main, before = import_module(f"app.{name}").main, signal.getsignal(signal.SIGTERM)
    command = import_module(main.__module__)
    monkeypatch.setattr(command, "Parser", mock.Mock(side_effect=error))
    assert main([]) == status
    assert capsys.readouterr().err == line
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.timeout(20)
@pytest.mark.parametrize("part", ["x", "a=", "a=.", "x= (-", "(-", " "])
def test_any_complaint_is_printed_in_linear_time(part, capsys):
    """A quadratic search takes hours."""
    line = 10**6 * part
    streams.print_error(line)
    assert capsys.readouterr().err == line + "\n"


@pytest.mark.parametrize("name", "solve convert plot report reproduce subsurface sweep verify xdmf".split())
def test_every_command_tells_its_version(name, capsys):
    with pytest.raises(SystemExit) as ended:
        if name == "solve":
            session.run(None, ["solve", "--version"])
        else:
            import_module(f"app.{name}").main(["--version"])
    assert (ended.value.code, capsys.readouterr().out) == (0, f"{__version__}\n")
