"""The V-cycle of docs/theory.md, Sec. 4.2 in numpy, and PETSc's PCMG do the same."""

import numpy as np
import pytest
from documents import ROOT, code_blocks, run_blocks
from mpi4py import MPI

from app import Grid
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.options.method import make_settings
from app.options.solver_options import SolverOptions


@pytest.mark.parametrize("share", [0.02, 0.4, 1.0])
def test_cycle_in_the_theory_equals_pcmg(share):
    [block] = code_blocks((ROOT / "docs" / "theory.md").read_text("utf-8"))
    page = run_blocks([block])
    rng = np.random.default_rng(3)
    n = page["n"]
    contact = rng.random((n, n)) < share
    contact[5, 7] = True
    r = np.where(contact, rng.normal(size=(n, n)), 0)
    expected = page["v_cycle"](np.zeros((n, n)), r, contact)

    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    hierarchy = Hierarchy(grid, page["kernel"], MPI.COMM_SELF)
    with SolverOptions("", make_settings("mg_v11").texts).inserted():
        solver = LinearSolver(hierarchy)
        hierarchy.target.mask[...] = contact
        solver.set_contact()
        right = solver.mat.createVecRight()
        right.setArray(r.reshape(-1))
        correction, _, failure = solver.solve(right, 0.0)
    assert not failure
    found = correction.getArray(readonly=True).reshape(n, n)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())
    solver.destroy()
    hierarchy.destroy()
