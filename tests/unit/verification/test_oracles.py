"""Comparisons with independent solvers."""

from types import SimpleNamespace

import numpy as np

from app.verification import oracles

from .figures import assert_limits_are_kept, each


def test_a_method_that_never_converges_is_compared_with_nothing(monkeypatch):
    def gives_up(problem, method, **how):
        assert method == "fmg_v11"
        return SimpleNamespace(converged=False, pressure=np.full(problem.grid.shape, 77.0))

    monkeypatch.setattr(oracles, "methods", lambda periodic: ["fmg_v11"])
    monkeypatch.setattr(oracles, "solved", gives_up)
    figures = oracles.every_method(True)
    assert figures and not any(figure.passed for figure in figures)


@each(oracles.CHECKS)
def test_figures_keep_their_limits(check):
    assert_limits_are_kept(check)
