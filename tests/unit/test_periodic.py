"""Periodic patches: influence coefficients, transfers, and the certificate."""

import periodic
import pytest

from app import ContactSolver
from app.base.errors import InputError


@pytest.mark.parametrize(
    ("method", "options", "match"),
    [
        ("fmg_v11", {"pc_mg_levels": "9"}, r"-pc_mg_levels 9: this grid allows 1 to 3"),
        (
            None,
            {"lcp_type": "fast"},
            r"-lcp_type fast: .*allowed on periodic ones: .*primal, active_set, tao, snesvi",
        ),
    ],
)
def test_what_cannot_be_done_is_said(method, options, match):
    with pytest.raises(InputError, match=match):
        ContactSolver(periodic.rough(9, 7, 1), method, options)
