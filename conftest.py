"""What every pytest session here needs first, doctests of app/ included: PETSc, started without pytest's arguments."""

import os

import petsc4py
import pytest

# Others work meanwhile: ranks that wait let them, and no rank has a core of its own.
os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
os.environ.setdefault("OMPI_MCA_hwloc_base_binding_policy", "none")
petsc4py.init([])
pytest.register_assert_rewrite("running", "cases", "results")
pytest_plugins = ["on_ranks"]  # tests/on_ranks.py
# The command, once imported, would hide the function of that name in what `from app import solve` finds.
collect_ignore = ["app/solve.py"]
