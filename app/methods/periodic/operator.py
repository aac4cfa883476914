"""Matrix O B O of the periodic method.

B is the inverse of A. O restricts fields to free cells, those outside contact.
"""

import numpy as np
from petsc4py import PETSc

from app.halfspace.mat_methods import symmetric_mat
from app.halfspace.operator import apply_logged
from app.methods.multilevel_operators import multilevel_inverse

_mult_event = PETSc.Log.Event("InverseMult")
_levels_event = PETSc.Log.Event("InverseByLevels")


class InverseOperator:
    """Inverse B of the influence matrix A, as a Mat context.

    Collective. The grid is periodic. B acts on displacements without mean; it maps constants to zero.

    Parameters
    ----------
    influence : InfluenceOperator
        Operator A on the same grid, with the same ranks and precision. It also counts the products.
    coarser : InfluenceOperator or None
        Operator A on a coarser grid, for the long waves of a preconditioner.

    Attributes
    ----------
    mask : ndarray of bool, shape (local rows, nx)
        Free cells, where the displacement is unknown: all cells without contact. Change it in place, then call
        `mask_changed`.
    products : int
        Number of products by the KSP.
    """

    def __init__(self, influence, coarser=None):
        self.influence, self.coarser = influence, coarser
        self.grid, self.slabs, self.comm = influence.grid, influence.slabs, influence.comm
        self.dtype, self.local_shape = influence.dtype, influence.local_shape
        self.petsc_comm, self.active = influence.petsc_comm, influence.active
        self.mask = np.zeros(self.local_shape, bool)
        self.products = self.contact_version = 0

    sweeps, coarser_levels = 0, ()  # for work units

    @property
    def product(self):
        """Product with the inverse B of A, in the iteration's precision."""
        return self.influence.inverse

    def spare_fields(self, *types):
        """Return unused storage of A as work fields, or None for each.

        See `InfluenceOperator.spare_fields`. Products on the coarser grid do not overwrite the fields.
        """
        coarser = self.coarser
        others = [coarser.screened_product] if coarser is not None and coarser.active else []
        return self.influence.spare_fields(*types, others=others)

    @property
    def multilevel(self):
        """Multilevel product with B, the inverse of A.

        The value is None on small grids, and for odd numbers of cells.
        """
        return multilevel_inverse(self.influence)

    def mat(self, comm):
        """Return a Mat with this operator as context. Collective over `comm`."""
        return symmetric_mat(self, comm)

    def mask_changed(self):
        """Register that the free cells have changed, for the preconditioner."""
        self.contact_version += 1

    def pressure(self, d, q):
        """Compute the pressure q that causes a displacement d."""
        apply_logged(_mult_event, self.product, d, q)

    def multilevel_pressure(self, d, q):
        """Compute the pressure q of a displacement d by multilevel product."""
        apply_logged(_levels_event, self.multilevel, d, q)

    def exact_pressure(self, w, p):
        """Compute the pressure p of a displacement w in double precision."""
        apply_logged(_mult_event, self.influence.exact_inverse, w, p)

    def mult(self, mat, x, y):
        """Compute y = O B O x for PETSc.

        B is the inverse of A, and O sets contact cells to zero.
        """
        self.products += 1
        with y as out:
            d = x.getArray(readonly=True).reshape(self.local_shape)
            apply_logged(_mult_event, self.product, d, out.reshape(self.local_shape), self.mask)

    def view(self, mat, viewer):
        """Describe the operator for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            grid = self.grid
            viewer.printfASCII(f"  inverse influence matrix of {grid.nx} x {grid.ny} cells, periodic\n")
