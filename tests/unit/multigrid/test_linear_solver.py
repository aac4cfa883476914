"""The linear solver of a contact system from PETSc options."""

import pytest
from cases import hertz

from app import ContactSolver, InputError


def test_preconditioners_that_need_the_matrix_are_refused():
    with pytest.raises(InputError, match="-pc_type eisenstat"):
        ContactSolver(hertz(12), "norm", {"pc_type": "eisenstat"})
