"""FFT preconditioner: the circulant matrix nearest to A in Strang's sense, restricted to the contact set.

The influence coefficients, wrapped around periodically on the *unpadded* grid, make a circulant matrix whose
eigenvalues ``lambda = rfft2(K wrapped)`` are positive; ``C F^-1 (1/lambda) F C`` costs about a quarter of a product.
(The periodic matrix of the padded grid has negative eigenvalues and is of no use.)

Usable wherever PETSc takes a PC, on the target grid and as a multigrid smoother::

    -pc_type python -pc_python_type app.multigrid.circulant.Circulant
    -mg_levels_pc_type python -mg_levels_pc_python_type app.multigrid.circulant.Circulant
"""

from __future__ import annotations

from functools import partial

import numpy as np
from petsc4py import PETSc
from scipy.fft import next_fast_len

from app.halfspace.convolution import EvenMultiplier
from app.halfspace.influence import influence_quadrant

_event = PETSc.Log.Event("CirculantPC")


def circulant_inverse(grid, compliance, slabs=None, comm=None, dtype=np.float64):
    """Inverse of the Strang circulant of the influence matrix.

    Collective over `comm`.

    Returns
    -------
    EvenMultiplier

    Raises
    ------
    ValueError
        If an eigenvalue is not positive.
    """
    ny, nx = grid.shape
    periods = next_fast_len(ny, real=True), next_fast_len(nx, real=True)
    inverse = EvenMultiplier(grid.shape, periods, slabs, comm, dtype)
    rows, columns = (min(period // 2 + 1, n) for period, n in zip(periods, grid.shape, strict=True))
    inverse.set_kernel(partial(influence_quadrant, grid, compliance), rows, columns)
    smallest = inverse.smallest_eigenvalue()
    if not smallest > 0:
        raise ValueError(
            f"circulant preconditioner: eigenvalue {smallest:g} on {nx} x {ny} cells is not positive"
        )
    inverse.scale_spectrum(np.reciprocal)
    return inverse


def circulant_of(operator):
    """Inverse circulant of an `InfluenceOperator`, made when first asked for. Collective over its ranks."""
    if operator.circulant is None:
        operator.circulant = circulant_inverse(
            operator.grid, operator.compliance, operator.slabs, operator.comm, operator.dtype
        )
    return operator.circulant


class Circulant:
    """PC context; its operator must be an `InfluenceOperator`. No options."""

    def setUp(self, pc):
        """Find the operator; the multiplier is made once per grid."""
        self.operator = pc.getOperators()[1].getPythonContext()
        circulant_of(self.operator)

    def apply(self, pc, x, y):
        """Compute y = C F^-1 (1/lambda) F C x."""
        operator = self.operator
        with _event, y as out:
            r = x.getArray(readonly=True).reshape(operator.local_shape)
            operator.circulant.apply(r, out.reshape(operator.local_shape), operator.mask)

    applyTranspose = apply

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            ny, nx = self.operator.circulant.periods
            viewer.printfASCII(f"  inverse of the Strang circulant, periods {nx} x {ny}\n")
