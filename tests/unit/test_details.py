"""Details of several modules: switches, limits, and what is restored afterwards."""

import math
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from unittest import mock

import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactSolver, Listener
from app.api.refinement import refine
from app.base import petsc
from app.base.errors import InputError
from app.cli.monitor import Progress


@pytest.mark.parametrize("listeners", [[print], [Listener], [None], Listener(), 3])
def test_what_is_no_listener_is_refused_before_any_work(listeners):
    with (
        mock.patch("app.api.solver.Hierarchy", side_effect=AssertionError),
        pytest.raises(InputError, match="^listeners: is .*; must be .*app.Listener$"),
    ):
        ContactSolver(hertz(12), listeners=listeners)


def test_each_solve_has_a_bar_of_its_own():
    """As those of a refinement, which share their listeners."""
    with (
        mock.patch("tqdm.tqdm") as bar,
        ContactSolver(hertz(12), "norm", listeners=[Progress()]) as solver,
    ):
        for opened in (1, 2):
            solver.solve(approach=APPROACH)
            assert bar.call_count == bar.return_value.close.call_count == opened


def test_a_bar_is_full_where_its_solve_ends():
    """At the tolerance of its grid, which a refinement tightens."""
    full = []
    with mock.patch("tqdm.tqdm") as bar:
        bar.return_value.close.side_effect = lambda: full.append(bar.return_value.n)
        options, listeners = {"lcp_rtol": 1e-3}, [Progress()]
        refine(hertz(12), 1e-6, 24**2, "norm", options, listeners=listeners, approach=APPROACH)
    assert full == [100, 100]


def test_the_bar_of_a_solver_that_diverges():
    with mock.patch("tqdm.tqdm") as bar:
        progress = Progress()
        progress.begin(SimpleNamespace(rtol=1e-6, monitor=False))
        progress.start(None, 0)
        for residual, done in ((math.nan, 0), (math.inf, 0), (1e-3, 50), (0.0, 100)):
            progress.iteration({"residual": residual, "level": 0, "iteration": 1, "contact_cells": 1}, None)
            assert bar.return_value.n == done


def test_the_gap_waits_for_a_solve_in_another_thread():
    found = solve(hertz(12), APPROACH)
    with ThreadPoolExecutor(1) as pool:
        with petsc._LOCK:
            gap = pool.submit(lambda: found.gap)
            with pytest.raises(TimeoutError):
                gap.result(0.05)
        assert gap.result().shape == found.pressure.shape
