"""The progress bar of the command."""

import math
from types import SimpleNamespace
from unittest import mock

from cases import APPROACH, hertz

from app import ContactSolver
from app.api.refinement import refine
from app.cli.monitor import Progress


def test_each_solve_has_its_own_bar():
    with mock.patch("tqdm.tqdm") as bar, ContactSolver(hertz(12), "norm", listeners=[Progress()]) as solver:
        for opened in (1, 2):
            solver.solve(approach=APPROACH)
            assert bar.call_count == bar.return_value.close.call_count == opened


def test_a_bar_is_full_when_its_solve_ends():
    """At the tolerance of its grid, which a refinement tightens."""
    full = []
    with mock.patch("tqdm.tqdm") as bar:
        bar.return_value.close.side_effect = lambda: full.append(bar.return_value.n)
        options, listeners = {"lcp_rtol": 1e-3}, [Progress()]
        refine(hertz(12), 1e-6, 24**2, "norm", options, listeners=listeners, approach=APPROACH)
    assert full == [100, 100]


def test_the_bar_of_a_diverging_solve_stays():
    with mock.patch("tqdm.tqdm") as bar:
        progress = Progress()
        progress.begin(SimpleNamespace(rtol=1e-6, monitor=False))
        progress.start(None, 0)
        for residual, done in ((math.nan, 0), (math.inf, 0), (1e-3, 50), (0.0, 100)):
            progress.iteration({"residual": residual, "level": 0, "iteration": 1, "contact_cells": 1}, None)
            assert bar.return_value.n == done
