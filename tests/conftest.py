"""Fixtures of all tests, and tests on several ranks: ``@pytest.mark.mpi(1, 2, 3)`` and an argument `ranks`."""

import pytest
import running


def pytest_generate_tests(metafunc):
    marker = metafunc.definition.get_closest_marker("mpi")
    named = [mark.args[0] for mark in metafunc.definition.iter_markers("parametrize")]
    if marker and marker.args and "ranks" in metafunc.fixturenames and "ranks" not in named:
        metafunc.parametrize("ranks", marker.args)


@pytest.fixture(scope="session")
def cli():
    """``cli("-grid", 8, ranks=2)``: run app.solve from outside."""

    def run_solve(*arguments, methods=(), **how):
        return running.run(*running.solve_arguments(*methods), *arguments, **how)

    return run_solve


@pytest.fixture(scope="session")
def mpiexec():
    """``mpiexec(3, "mpi_operator.py", ...)``: run a script of this folder; it must succeed."""

    def run_script(ranks, script, *arguments, **how):
        done = running.run(running.TESTS / script, *arguments, ranks=ranks, **how)
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        return done.stdout

    return run_script
