"""The direct solver of the coarsest grid."""

import numpy as np

from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.multigrid.direct import DirectSolver


def test_direct_solver_solves_contact_sets_in_turn():
    operator, rng = InfluenceOperator(Grid(20, 16, 0.5, 1.0), UNIT), np.random.default_rng(3)
    solver, right = DirectSolver(operator), operator.mat().createVecRight()
    h = rng.normal(size=operator.local_shape)
    one, other = (rng.random(h.shape) < share for share in (0.3, 0.6))
    for contact in (one, one, other, np.zeros_like(one), one):
        operator.mask[...] = contact
        solver.set_contact()
        right.setArray(np.where(contact, -h, 0.0).reshape(-1))
        p, _, failure = solver.solve(right)
        p = p.getArray(readonly=True).reshape(h.shape)
        u = np.empty_like(h)
        operator.displacement(p * contact, u)
        assert not failure and (p[~contact] == 0).all()
        np.testing.assert_allclose((u + h)[contact], 0, atol=1e-12)
    for part in (solver, right):
        part.destroy()
