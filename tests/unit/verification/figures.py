"""Checks of `app.verify` on small cases."""

import pytest


def each(checks):
    """Parametrize a test by `check`."""
    return pytest.mark.parametrize("check", checks, ids=lambda check: check.name)


def assert_limits_are_kept(check):
    figures = check.measure(True)
    assert any(figure.judged for figure in figures)
    failed = [
        f"{figure.what}: {figure.value:.3g}, has to be {figure.limit}"
        for figure in figures
        if not figure.passed
    ]
    assert not failed
