"""A process that solves for ever holds what it held after a few solves."""

import json

import pytest
from petsc4py import PETSc
from processes import TESTS, run


@pytest.mark.parametrize("rounds", [4, pytest.param(18, marks=pytest.mark.slow)])
def test_memory_objects_and_communicators_stay_flat(rounds):
    """38 solves, or 304; `tests/soak.py` says which."""
    done = run(TESTS / "soak.py", rounds, timeout=60 * rounds)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    before, after = told["before"], told["after"]
    assert told["solves"] == (rounds - 2) * 19
    assert before.pop("memory") > after.pop("memory") - 4  # MiB; one solve holds 1 and more
    assert before == after
    if PETSc.Sys.getVersion() < (3, 22):
        assert before["petsc"] >= 2  # a vector that is kept, and the viewer that tells
    assert told["garbage"] == 0  # bytes of arrays that only a collection of garbage would free
