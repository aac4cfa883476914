"""Fixtures of all tests.

Folders: unit (pieces), validation (against the paper, analytic solutions, oracles, invariances), cli (what
users type), mpi (what several ranks do). Two kinds of tests use several ranks:

- ``@pytest.mark.mpi(2, 3)`` with an argument `comm`: the *test* runs on every rank (see `on_ranks`).
- ``@pytest.mark.ranks(2, 3)`` with an argument `ranks`: the test runs here and starts a *command* on that many
  ranks, by ``cli(..., ranks=ranks)`` or ``processes.run(..., ranks=ranks)``.
"""

import gc
import signal
import subprocess
import sys

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


@pytest.fixture
def cli_here(capfd, monkeypatch):
    """``cli_here("-grid", 8)``: what `cli` runs on one rank, but in this process, for starting one takes a second.

    Not for parts of a user's own, -log_view and how a process ends.
    """
    from petsc4py import PETSc

    import app
    from app.base import numba_cache
    from app.cli import session, solve

    vars(app).pop("solve", None)  # which the module has hidden

    def run_solve(*arguments, methods=(), cwd=processes.TESTS.parent, main=solve.main):
        line = [*processes.solve_arguments(*methods)[1:], *map(str, arguments)]
        capfd.readouterr()
        handler, before = signal.getsignal(signal.SIGPIPE), PETSc.Options().getAll()
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as end:
            patch.chdir(cwd)
            patch.setattr(sys, "argv", line)
            patch.setattr(sys, "path", [*sys.path])
            patch.setattr(numba_cache, "on_first_compile", numba_cache.on_first_compile)
            session.run(main)
        signal.signal(signal.SIGPIPE, handler)
        for name in PETSc.Options().getAll().keys() - before.keys():
            PETSc.Options().delValue(name)
        gc.unfreeze()
        return subprocess.CompletedProcess(line, end.value.code, *capfd.readouterr())

    return run_solve
