"""Comparisons with analytic solutions."""

from app.verification import analytic

from .figures import assert_limits_are_kept, each


@each(analytic.CHECKS)
def test_figures_keep_their_limits(check):
    assert_limits_are_kept(check)
