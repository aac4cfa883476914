"""Tests on several ranks: each fails by name if it fails, crashes or hangs on any rank, and nothing hangs for ever."""

import re

from processes import TESTS, run

BEGIN = """
import os
import pytest

pytestmark = pytest.mark.mpi(2)
"""
CONFTEST = "import petsc4py; petsc4py.init([])\npytest_plugins = ['on_ranks']"


def outcomes(folder, body, seconds=20):
    """Run a file of tests; return the outcome of each and all that was said."""
    (folder / "test_them.py").write_text(BEGIN + body)
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "pytest.ini").write_text(f"[pytest]\npythonpath = {TESTS}\nseconds_on_ranks = {seconds}")
    done = run("-m", "pytest", "-v", cwd=folder)
    found = re.findall(r"^test_them.py::test_(\w+)\S* (\w+)", done.stdout, re.M)
    return dict(found), done.stdout


def test_outcomes_are_those_of_all_ranks_and_a_failure_on_one_leaves_the_next_test_alone(tmp_path):
    found, said = outcomes(
        tmp_path,
        """
def test_rank(comm):
    assert comm.allgather(comm.rank) == [0, 1]

def test_one_fails(comm):
    print("heard of it")
    assert comm.rank == 0, "the other one"

def test_next(comm):
    assert comm.allreduce(1) == 2

def test_skipped(comm):
    pytest.skip("not here")

def test_folder(comm, tmp_path):
    (tmp_path / str(comm.rank)).touch()
    comm.Barrier()
    assert len(list(tmp_path.iterdir())) == 2

@pytest.mark.mpi(1)
def test_alone(comm):
    assert comm.size == 1
""",
    )
    assert found == {
        "rank": "PASSED", "one_fails": "FAILED", "next": "PASSED", "skipped": "SKIPPED", "folder": "PASSED",
        "alone": "PASSED",
    }  # fmt: skip
    assert "--- rank 1" in said
    assert "--- rank 0" not in said
    assert "AssertionError: the other one" in said
    assert "heard of it" in said


def test_ranks_that_wait_for_ever_or_crash_are_ended_and_the_next_test_is_run(tmp_path):
    found, said = outcomes(
        tmp_path,
        """
def test_before(comm):
    pass

def test_raises(comm):
    if comm.rank == 0:
        raise KeyError("what is missing")
    comm.Barrier()

def test_between(comm):
    assert comm.allreduce(1) == 2

def test_crashes(comm):
    if comm.rank == 1:
        os.abort()
    comm.Barrier()

def test_after(comm):
    assert comm.allreduce(1) == 2

def test_hangs(comm):
    comm.Recv(bytearray(1), source=1 - comm.rank)

def test_last(comm):
    pass
""",
        seconds=2,
    )
    assert found == {
        "before": "PASSED", "raises": "FAILED", "between": "PASSED", "crashes": "FAILED", "after": "PASSED",
        "hangs": "FAILED", "last": "FAILED",
    }  # fmt: skip
    assert "KeyError: 'what is missing'" in said
    assert "Aborted" in said
    assert "in test_hangs" in said
    assert "not run: test_them.py::test_hangs[2ranks] and others ended the job" in said


def test_a_job_that_crashes_at_its_end_is_a_failure(tmp_path):
    found, said = outcomes(
        tmp_path,
        """
def test_first(comm):
    pass

def test_last(comm):
    import atexit
    atexit.register(os.abort)
""",
    )
    assert found == {"first": "PASSED", "last": "FAILED"}
    assert "after this last test on 2 ranks" in said
