"""Linear solver of the default method."""

import pytest
from cases import hertz

from app import ContactSolver, InputError


def test_ksp_without_a_known_displacement_raises():
    with pytest.raises(InputError, match="-ksp_type: -lcp_type fast needs one that starts from a known"):
        ContactSolver(hertz(12), "fast", {"ksp_type": "cg"})
