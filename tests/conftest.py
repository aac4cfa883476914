"""Fixtures of all tests.

Folders: unit (pieces), validation (against the paper, analytic solutions, oracles, invariances), commands (what
users type), mpi (what several ranks do). Two kinds of tests use several ranks:

- ``@pytest.mark.mpi(2, 3)`` with an argument `comm`: the *test* runs on every rank (see `on_ranks`).
- ``@pytest.mark.ranks(2, 3)`` with an argument `ranks`: the test runs here and starts a *command* on that many
  ranks, by ``cli(..., ranks=ranks)`` or ``processes.run(..., ranks=ranks)``.
"""

import processes
import pytest


def pytest_generate_tests(metafunc):
    marker = metafunc.definition.get_closest_marker("ranks")
    if marker:
        metafunc.parametrize("ranks", marker.args)


@pytest.fixture(scope="session")
def cli():
    """``cli("-grid", 8, ranks=2)``: run app.solve from outside."""

    def run_solve(*arguments, methods=(), **how):
        return processes.run(*processes.solve_arguments(*methods), *arguments, **how)

    return run_solve
