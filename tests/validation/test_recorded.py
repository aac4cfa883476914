"""Recorded solves: operator applications are nearly as before, on one rank and on two.

Counts differ a little between processors, and those of the safeguard differ more: of forced solves only the result is
compared. `python tests/recorded.py` compares everything, to the last bit on one machine.
"""

import pytest
import recorded
from mpi4py import MPI

CASES, TABLE = recorded.cases(), recorded.read()


def assert_as_recorded(name, comm):
    case, expected = CASES[name], TABLE[name, comm.size]
    found = recorded.solve(name, case, comm)
    assert found.converged
    assert bool(found.fallbacks) == bool(expected.fallbacks) == case.forced
    for quantity in ("load", "approach"):
        found_value, value = float(getattr(found, quantity)), float(getattr(expected, quantity))
        assert found_value == pytest.approx(value, rel=1e-3, abs=1e-5)
    if not case.forced:
        applications = float(expected.operator_applications)
        assert float(found.operator_applications) == pytest.approx(applications, rel=0.1, abs=1.5)


@pytest.mark.parametrize("name", CASES)
def test_counts_are_as_recorded(name):
    assert_as_recorded(name, MPI.COMM_SELF)


@pytest.mark.mpi(2)
@pytest.mark.parametrize("name", CASES)
def test_counts_on_two_ranks_are_as_recorded(comm, name):
    assert_as_recorded(name, comm)


def test_table_has_all_cases():
    assert set(TABLE) == {(name, ranks) for name in CASES for ranks in (1, 2)}
