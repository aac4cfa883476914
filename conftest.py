"""What every pytest session here needs first, doctests of app/ included: PETSc, started without pytest's arguments."""

import os
import signal

import app  # noqa: F401  # isort: skip  # first, so that petsc4py of wheels finds MPI

import petsc4py
import pytest

# Others work meanwhile: ranks that wait let them, and no rank has a core of its own.
os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
os.environ.setdefault("OMPI_MCA_hwloc_base_binding_policy", "none")
# Shells start what runs in the background with SIGINT ignored; commands that tests start would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
petsc4py.init([])
pytest.register_assert_rewrite("running", "cases", "results")
pytest_plugins = ["on_ranks"]  # tests/on_ranks.py


def pytest_configure(config):
    """Hide notes on the solutions of tests."""
    config.addinivalue_line("filterwarnings", "ignore::app.base.errors.NoteWarning")


def pytest_ignore_collect(collection_path, config):
    """Collect test files, and the examples in app/; no other module is imported to look for examples."""
    if collection_path.suffix != ".py" or collection_path.name == "__init__.py":
        return None
    if config.rootpath / "app" in collection_path.parents:
        # The command, once imported, would hide the function of that name in what `from app import solve` finds.
        return True if collection_path.name in ("solve.py", "fast.py") else None  # fast: deprecated, warns
    return None if collection_path.name.startswith("test_") else True
