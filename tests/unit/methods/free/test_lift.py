"""Lifted pressures."""

from cases import APPROACH, hertz

from app import solve


def test_lift_saves_work_against_copy():
    lifted, copied = (
        solve(hertz(256), approach=APPROACH, options={"lcp_prolongation": kind}) for kind in ("lift", "copy")
    )
    assert lifted.operator_applications < copied.operator_applications
