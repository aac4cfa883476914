"""Start of MPI, and the environment."""

import os
import subprocess
import sys

import pytest
from processes import TESTS, run

from app.base import mpi

ONE_HOST = {"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_LOCAL_SIZE": "4"}


@pytest.mark.parametrize(
    ("environment", "alone"),
    [
        ({}, True),
        (ONE_HOST, True),
        (ONE_HOST | {"PMIX_RANK": "0"}, True),  # mpiexec's own
        (ONE_HOST | {"OMPI_COMM_WORLD_SIZE": "8"}, False),
        ({"PMIX_RANK": "0"}, False),
        ({"SLURM_STEP_ID": "1"}, False),
        ({"SLURM_JOB_ID": "17"}, True),  # the script of a job, without srun
        ({"OMPI_MCA_pml": "ucx"}, False),
        (ONE_HOST | {"OMPI_MCA_btl": "tcp,self"}, False),
        (ONE_HOST | {"OMPI_VERSION": "5.0.7"}, True),
        # With another word Open MPI refuses it.
        (ONE_HOST | {"OMPI_MCA_btl_tcp_if_exclude": "docker0"}, False),
    ],
)
def test_the_search_for_networks_is_skipped_only_on_a_single_host(environment, alone):
    found = mpi.single_host_variables(environment)
    assert bool(found) == alone
    assert not found.keys() & environment.keys()


def test_a_temporary_environment_is_restored(monkeypatch):
    monkeypatch.setenv("CONTACT_KEPT", "1")
    monkeypatch.delenv("CONTACT_NEW", raising=False)
    before = dict(os.environ)
    with (
        pytest.raises(KeyError),
        mpi.temporary_environment({"CONTACT_KEPT": None, "CONTACT_NEW": "2", "CONTACT_NEVER": None}),
    ):
        assert "CONTACT_KEPT" not in os.environ
        assert os.environ["CONTACT_NEW"] == "2"
        raise KeyError
    assert dict(os.environ) == before


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


START = """
import subprocess, sys
from app.base.mpi import MPI
program = "from mpi4py import MPI; MPI.COMM_WORLD.rank or print(MPI.COMM_WORLD.size)"
subprocess.run(["mpiexec", "-n", "2", sys.executable, "-c", program])
"""


def test_a_notebook_can_start_ranks_by_mpiexec():
    """A single rank leaves no variables of Open MPI to the programs that it starts."""
    assert run("-c", START).stdout.split() == ["2"]


@pytest.mark.parametrize(
    ("module", "end"), [("mpi4py.MPI", "MPI.Finalize"), ("petsc4py.PETSc", "PETSc._finalize")]
)
@pytest.mark.parametrize("first", ["import app", "from app import solve"])
def test_a_library_that_the_user_has_finalized_is_named(module, end, first):
    package, name = module.split(".")
    program = (
        f"{first}; from {package} import {name}; {end}()\nfrom app import ContactSolver; ContactSolver(None)"
    )
    done = run("-c", program)
    assert done.returncode  # PETSc may abort at the end, because MPI has ended before
    message = f"InputError: {module} has been finalized; do this after the last solve"
    assert f"app.base.errors.{message}" in done.stderr.splitlines()
