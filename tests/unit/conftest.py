"""Fixtures of several folders: a result file, option files, files of many cells, instant runs."""

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from results import made_up_result, with_attributes, write

from app.base import memory
from app.cli import option_sources
from app.halfspace.fft.multiplier import EvenMultiplier
from app.methods.free.solver import TrackingSolver
from app.parallel.slabs import Slabs
from app.parameter_study import batch


@pytest.fixture(scope="module")
def made():
    return with_attributes(made_up_result(64, 48), notes="first note\nsecond note", error_bound=3e-4)


@pytest.fixture
def path(made, tmp_path):
    write(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(48), made)
    return tmp_path / "result.h5"


@pytest.fixture
def read(tmp_path, monkeypatch):
    """``read("-grid 8", load="5")``: read a command line in an empty folder; PETSc has started with a load."""
    monkeypatch.chdir(tmp_path)

    def read_line(line="", **started_with):
        database = PETSc.Options()
        for name, text in started_with.items():
            database.setValue(name, text)
        try:
            return option_sources.parse_options(["solve.py", *line.split()])
        finally:
            for name in started_with:
                database.delValue(name)
            assert not database.getAll()  # reading leaves nothing there

    return read_line


@pytest.fixture
def files(tmp_path):
    """Write files of these contents into the folder."""

    def write(**contents):
        for name, content in contents.items():
            path = tmp_path / name.replace("__", ".")
            path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)

    return write


@pytest.fixture
def sparse(tmp_path):
    """``sparse("gap.npy", n)``: a file of n x n cells without content, a few kB on the disk."""

    def make(name, n):
        path = tmp_path / name
        if name.endswith(".h5"):
            with h5py.File(path, "w") as file:
                file.create_dataset("gap", (n, n), "f8", chunks=(1000, 1000))
        else:
            with path.open("wb") as file:
                if name.endswith(".npy"):
                    header = {"descr": "<f8", "fortran_order": False, "shape": (n, n)}
                    np.lib.format.write_array_header_1_0(file, header)
                file.truncate(file.tell() + 8 * n * n)
        return str(path)

    return make


@pytest.fixture
def small_machine(monkeypatch):
    """One GiB of free memory."""
    monkeypatch.setattr(memory, "available_memory", lambda: 1 << 30)


@pytest.fixture
def created(monkeypatch):
    """Return the list of the spectra and linear solvers that are created."""
    names = []

    def count(of, name):
        plain = getattr(of, name)
        monkeypatch.setattr(of, name, lambda *given, **named: (names.append(name), plain(*given, **named))[1])

    count(EvenMultiplier, "set_kernel")
    count(TrackingSolver, "__init__")
    return names


@pytest.fixture
def performed(monkeypatch):
    """Replace the program by one that solves at once; return the list of what was run."""
    calls = []

    def perform(run, output, processes, ranks=1, timeout=None):
        calls.append(dict(run.options))
        status = {"crash": 1, "refused": 2}.get(run.options.get("grid"), 0)
        return {"exit_status": status, "message": "", "load": np.float64(len(calls))}

    monkeypatch.setattr(batch, "perform", perform)
    return calls
