"""Random histories of creep and wear, and random tilts: no error exceeds its bound.

``CONTACT_EXAMPLES=2000 python -m pytest tests/validation/test_histories.py`` tries so many of each kind on one rank,
and a tenth of them on several ranks; `tests/histories.py` says what is compared, and runs any of them as a command.
"""

import os

import histories
import pytest

EXAMPLES = int(os.environ.get("CONTACT_EXAMPLES", 30))


def check(kind, count, comm):
    """No law is broken, and almost all solutions are solved and compared."""
    failures, counts = histories.run(kind, range(100 * comm.size, 100 * comm.size + count), comm)
    assert not failures
    if comm.rank == 0:
        assert counts["compared"] > 0.95 * counts["steps"] > 0
        assert counts["not converged"] <= 0.05 * counts["steps"]


@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", histories.CHECKS)
def test_no_error_exceeds_its_bound(kind, comm):
    check(kind, EXAMPLES, comm)


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("kind", histories.CHECKS)
def test_no_error_exceeds_its_bound_on_several_ranks(kind, comm):
    check(kind, EXAMPLES // 10, comm)
