"""The checks of app.verify on small cases, each a test."""

import pytest

from app.verification.document import CHECKS


@pytest.mark.parametrize("name", [name for name in CHECKS if name != "ranks"])  # tests/mpi has that
def test_figures_keep_their_limits(name):
    figures = CHECKS[name].measure(True)
    assert any(figure.judged for figure in figures)
    failed = [
        f"{figure.what}: {figure.value:.3g}, has to be {figure.limit}"
        for figure in figures
        if not figure.passed
    ]
    assert not failed
