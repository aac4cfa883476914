"""Rows that change place, ranks that have no part in a grid, and how often a solve talks."""

import numpy as np
import pytest
from cases import hertz, punch

from app import ContactSolver
from app.base.petsc import _counter, logged_reductions
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.kernel import UNIT
from app.methods.multilevel_operators import multilevel_influence
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import temporary_options
from app.parallel.communicator import Communicator


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize(("n", "levels"), [(48, 0), (192, 1), (324, 2)])
@pytest.mark.parametrize("by_levels", [False, True])
@pytest.mark.parametrize("scattered", [False, True])
def test_cg_step_needs_two_reductions_and_four_exchanges(comm, n, levels, shared, by_levels, scattered):
    counted = Communicator(comm)
    counted.shares_memory = shared
    hierarchy = Hierarchy(hertz(n).grid, UNIT, counted, cells_per_rank=10**6, dtype=np.float32)
    operator, traffic = hierarchy.target, hierarchy.comm.traffic
    counts = {}
    options = {
        "ksp_type": "python",
        "ksp_python_type": "app.methods.free.tracking_cg.TrackingCG",
        "ksp_norm_type": "unpreconditioned",
        "ksp_rtol": "1e-14",
        "pc_type": "python",
        "pc_python_type": "app.methods.free.circulant.Circulant",
        "pc_circulant_extend": "3",
        "pc_circulant_blocks": "16" if scattered else "0",
    }
    for steps in (1, 3):  # so few that the norm needs no summing anew
        with temporary_options("", {}, options | {"ksp_max_it": str(steps)}):
            solver = LinearSolver(hierarchy)
        nearly = multilevel_influence(operator) if by_levels else None
        if nearly is not None:
            solver.ksp.getPythonContext().multiply = nearly.apply
        b = solver.mat.createVecRight()
        operator.mask[...] = True
        operator.mask[:, 40:] = False
        if scattered:
            operator.mask[...] = np.logical_and.outer(*(np.arange(m) % 24 < 12 for m in operator.mask.shape))
        solver.set_contact()
        b.setArray(operator.mask.reshape(-1).astype(float))
        before = traffic.copy()
        _, iterations, failure = solver.solve(b, 0.0)
        assert (iterations, failure) == (steps, "")
        counts[steps] = traffic.since(before)
        b.destroy()
        solver.destroy()
    step = counts[3].since(counts[1])
    neighbours = 2 - (comm.rank == 0) - (comm.rank == comm.size - 1)
    in_box = levels == 2 and nearly is None
    assert step.small_collectives == 2 * (2 + in_box)
    assert step.all_to_alls == 2 * 4
    sent = 0 if shared else 4 * (comm.size - 1)
    exchanges = 2 + 2 * levels * (1 + (nearly is not None))
    assert step.messages == 2 * (sent + exchanges * neighbours)
    hierarchy.destroy()


@pytest.mark.mpi(2, 3)
@pytest.mark.parametrize("problem", [hertz(160), punch(160)], ids=["hertz", "punch"])
def test_message_count_of_a_solve_follows_the_model(comm, problem, monkeypatch):
    """The model of docs/notebook/scaling.md; a second solve makes no spectra, a third does the same."""
    products, spectra = [], []
    apply, set_kernel = EvenMultiplier.apply, EvenMultiplier.set_kernel
    monkeypatch.setattr(
        EvenMultiplier, "apply", lambda self, *a, **k: (products.append(self.comm), apply(self, *a, **k))[1]
    )
    monkeypatch.setattr(
        EvenMultiplier, "set_kernel", lambda self, *a: (spectra.append(self.comm), set_kernel(self, *a))[1]
    )
    with ContactSolver(problem, "fast", {"lcp_cells_per_rank": 512}) as solver:
        products.clear()
        spectra.clear()
        logged = _counter("petsc_isend_ct").value
        first = solver.solve(approach=0.1)
        logged = _counter("petsc_isend_ct").value - logged
        shared = [sum(used is not None for used in made) for made in (products, spectra)]
        again = solver.solve(approach=0.1).traffic
        assert 0 < again.messages < first.traffic.messages
        assert solver.solve(approach=0.1).traffic == again
    traffic, levels = first.traffic, len(set(first.history["level"]))
    steps, sets = sum(first.history["inner_iterations"]), len(first.history["level"])
    if comm.rank == 0:
        assert logged == traffic.messages  # as -log_view tells
        assert traffic.all_to_alls == 2 * shared[0] + shared[1]
    assert traffic.small_collectives <= 2 * steps + 3 * sets + 6 * levels + 10
    assert first.attributes["all_to_alls"] == traffic.all_to_alls > 0


@pytest.mark.mpi(2)
@pytest.mark.parametrize("method", ["norm", "fmg_v11", "fast"])
def test_reductions_of_a_solve_are_those_that_petsc_counts(comm, method):
    """PETSc's CG sums twice a step, by itself; some sums compare arguments before the solve and numbers after it."""
    with ContactSolver(hertz(32), method) as solver:
        before = logged_reductions()
        solution = solver.solve(approach=0.1)
        counted = logged_reductions() - before
    if comm.rank == 0:
        assert counted - 5 <= solution.traffic.small_collectives <= counted
    if method == "norm":
        assert solution.traffic.small_collectives > 2 * solution.inner_iterations
