"""Details of several modules: switches, limits, and what is restored afterwards."""

import math
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactSolver, Listener
from app.api.refinement import refine
from app.base import petsc
from app.base.errors import InputError
from app.cli.monitor import Progress
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.operator import InfluenceOperator, wrap_vec
from app.halfspace.product import DenseProduct


def test_a_product_counts_once():
    grid = Grid(3, 2, 1.0, 1.0)
    product, p = DenseProduct(dense_matrix(grid, 1.0), grid.shape), np.ones(grid.shape)
    product.apply(p, np.empty_like(p))
    product.apply(p, np.empty_like(p), p > 0)
    assert product.count == 2


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


def test_a_vec_is_in_the_memory_of_its_field():
    operator = InfluenceOperator(Grid(3, 2, 1.0, 1.0), 1.0)
    with pytest.raises(ValueError, match="C-contiguous"):
        wrap_vec(np.zeros((2, 3), order="F"), operator)
    field = np.zeros((2, 3))
    vec = wrap_vec(field, operator)
    vec.set(1.0)
    assert (field == 1).all()
    vec.destroy()


@pytest.mark.parametrize("kind", [32, 32 | 16, 64, 128])
def test_sweeps_by_parts_of_the_matrix_are_refused(kind):
    """SOR_EISENSTAT and its like; x as it was would be taken for an answer."""
    operator = InfluenceOperator(Grid(4, 3, 1.0, 1.0), 1e-5)
    with pytest.raises(ValueError, match="by parts of the matrix"):
        operator.SOR(None, None, 1.0, kind, 0.0, 1, 1, None)


def test_the_gap_waits_for_a_solve_in_another_thread():
    found = solve(hertz(12), APPROACH)
    with ThreadPoolExecutor(1) as pool:
        with petsc._LOCK:
            gap = pool.submit(lambda: found.gap)
            with pytest.raises(TimeoutError):
                gap.result(0.05)
        assert gap.result().shape == found.pressure.shape
