"""The check of app.verify that needs ranks, on small cases."""

import pytest
from mpi4py import MPI

from app.verification.ranks import compare, solve_all


@pytest.mark.mpi(2)
def test_two_ranks_find_what_one_does(comm):
    together, alone = solve_all(True, comm), solve_all(True, MPI.COMM_SELF)
    if comm.rank == 0:
        figures = compare({1: alone, 2: together})
        assert len(figures) > 5
        assert not [figure for figure in figures if not figure.passed]
