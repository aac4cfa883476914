"""The influence matrix as a PETSc Mat."""

from unittest import mock

import numpy as np
import pytest
from operators import GRIDS
from petsc4py import PETSc

from app.halfspace import influence
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator, wrap_vec


def test_mult_invalidates_cached_norms():
    grid = GRIDS["odd"]
    operator = InfluenceOperator(grid, UNIT)
    operator.mask[...] = True
    mat = operator.mat(PETSc.COMM_SELF)
    x, y = mat.createVecs()
    y.set(0)
    assert y.norm() == 0  # PETSc keeps this norm as long as it knows of no change
    x.set(1)
    mat.mult(x, y)
    assert y.norm() == pytest.approx(np.linalg.norm(y.getArray(readonly=True)), rel=1e-14)
    assert y.norm() > 0
    assert mat.isSymmetricKnown() == (True, True)
    x.destroy()
    y.destroy()
    mat.destroy()
    assert not mat


def test_periodic_quadrant_is_computed_once():
    operator = InfluenceOperator(Grid(64, 200, 1.0, 1.0, periodic="spectral"), UNIT)
    with mock.patch.object(influence, "periodic_quadrant", wraps=influence.periodic_quadrant) as compute:
        assert operator.relaxation is operator.relaxation
        assert operator.diagonal > 0
    assert compute.call_count == 1


def test_energy_of_contact_follows_cells_that_leave():
    """In step 4.a cells leave, and no solver has been told yet."""
    operator = InfluenceOperator(Grid(12, 10, 1.0, 1.0, periodic="love"), UNIT)
    operator.mask[...] = False
    operator.mask[2:6, 2:6] = True
    operator.mask_changed()
    before = operator.energy_of_contact()
    operator.mask[2] = False
    energy, cells = operator.energy_of_contact()
    p, u = operator.mask.astype(float), np.empty(operator.local_shape)
    operator.displacement(p, u)
    assert (energy, cells) == (np.vdot(p, u), 12) != before


def test_wrapped_vec_shares_memory_of_its_field():
    operator = InfluenceOperator(Grid(3, 2, 1.0, 1.0), UNIT)
    with pytest.raises(ValueError, match="C-contiguous"):
        wrap_vec(np.zeros((2, 3), order="F"), operator)
    field = np.zeros((2, 3))
    vec = wrap_vec(field, operator)
    vec.set(1.0)
    assert (field == 1).all()
    vec.destroy()


@pytest.mark.parametrize("kind", [32, 32 | 16, 64, 128])
def test_sor_refuses_sweeps_by_parts_of_the_matrix(kind):
    """SOR_EISENSTAT and its like; x as it was would be taken for an answer."""
    operator = InfluenceOperator(Grid(4, 3, 1.0, 1.0), UNIT)
    with pytest.raises(ValueError, match="by parts of the matrix"):
        operator.SOR(None, None, 1.0, kind, 0.0, 1, 1, None)
