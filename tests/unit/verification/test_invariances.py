"""Invariances of solutions."""

from app.verification import invariances

from .figures import assert_limits_are_kept, each


@each(invariances.CHECKS)
def test_figures_keep_their_limits(check):
    assert_limits_are_kept(check)
