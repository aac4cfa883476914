"""What every pytest session here needs first, doctests of app/ included: PETSc, started without pytest's arguments."""

import petsc4py
import pytest

petsc4py.init([])
pytest.register_assert_rewrite("running", "cases", "results")
pytest_plugins = ["on_ranks"]  # tests/on_ranks.py
# The command, once imported, would hide the function of that name in what `from app import solve` finds.
collect_ignore = ["app/solve.py"]
