"""Methods of the influence matrix as PETSc Mat.

User programs need these methods; the solvers of this program do not. A Mat is ``a C A C + s I``, where C restricts
fields to the contact set. Each Mat has its own numbers a and s. All Mats of an operator share its contact set.
"""

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.base.petsc import report_no_entries
from app.halfspace.fft.multiplier import Layout
from app.halfspace.influence import quadrant_rows
from app.halfspace.product import Convolution
from app.parallel.reductions import minimum_over, sum_over

_FACTORS = "factors"  # attribute of a Mat


def scale_and_shift(mat):
    """Return a Mat's factor a and shift s."""
    return (mat and mat.getAttr(_FACTORS)) or (1.0, 0.0)


def check_unscaled(mat, solver):
    """Raise InputError for a `solver` whose Mat was scaled or shifted."""
    if scale_and_shift(mat) != (1.0, 0.0):
        raise InputError(f"{solver}: needs a Mat that is neither scaled nor shifted")


def _set_factors(mat, a, s):
    mat.setAttr(_FACTORS, (a, s))
    mat.setOption(PETSc.Mat.Option.SPD, a > 0 and s >= 0)
    mat.setOption(PETSc.Mat.Option.SYMMETRIC, True)


def symmetric_mat(context, comm):
    """Return a symmetric positive definite Mat with a Python context. Collective.

    `context` is the operator that the Mat calls; `comm` has the ranks that own its rows.
    """
    size = context.local_shape[0] * context.local_shape[1], context.grid.n
    mat = PETSc.Mat().createPython((size, size), context, comm=comm)
    mat.setName(f"contact {context.grid.nx} x {context.grid.ny}")
    for option in ("HERMITIAN", "SYMMETRY_ETERNAL", "SPD"):
        mat.setOption(getattr(PETSc.Mat.Option, option), True)
    mat.setUp()
    report_no_entries(mat)
    return mat


class MatMethods:
    """Mat methods for assembly, copies, scales, shifts, norms and views. Collective."""

    def assemblyEnd(self, mat, kind):
        """Adopt the contact set; then PETSc sets up its preconditioners again."""
        self.mask_changed()

    def duplicate(self, mat, _=None):
        """Return another Mat of this operator, with equal factor and shift."""
        other = self.mat(mat.comm)
        other.setAttr(_FACTORS, scale_and_shift(mat))
        return other

    def scale(self, mat, factor):
        """Multiply the Mat by a number."""
        a, s = scale_and_shift(mat)
        _set_factors(mat, factor * a, factor * s)

    def shift(self, mat, summand):
        """Add a multiple of the identity on all cells, also outside contact."""
        a, s = scale_and_shift(mat)
        _set_factors(mat, a, s + summand)

    def norm(self, mat, kind):
        """Return a norm: 1 or infinity, which are equal by symmetry, or Frobenius."""
        squared = kind == PETSc.NormType.FROBENIUS
        if not squared and kind not in (PETSc.NormType.NORM_1, PETSc.NormType.INFINITY):
            raise ValueError("norm of an influence matrix: must be NORM_1, FROBENIUS or INFINITY")
        (a, s), power, diagonal = scale_and_shift(mat), 2 if squared else 1, self._own_entries()
        sums = self._row_sums(power) - self.diagonal**power
        sums = abs(a) ** power * sums + abs(a * diagonal + s) ** power
        sums = np.where(self.mask, sums, abs(s) ** power)
        if squared:
            return float(np.sqrt(sum_over(self.comm, [sums.sum()])[0]))
        return float(-minimum_over(self.comm, [-sums.max(initial=0.0)])[0])

    def _row_sums(self, power):
        """Return, for each row I, the sum of ``|A_IJ|^power`` over J in contact."""
        if not self.active:
            return np.zeros(self.local_shape)
        rows, sums = quadrant_rows(self.grid, self.kernel), np.empty(self.local_shape)
        layout = Layout(self.slabs, self.comm, np.float64)
        entries = Convolution(lambda selected: np.abs(rows(selected)) ** power, self.grid.shape, layout)
        entries.apply(self.mask.astype(float), sums)
        return sums

    def getDiagonal(self, mat, diagonal):
        """Store a Mat's diagonal; outside contact, arbitrary nonzero numbers."""
        a, s = scale_and_shift(mat)
        with diagonal as values:
            values[...] = (a * self._own_entries() + s).ravel()

    def _own_entries(self):
        """Return the diagonal of the matrix, shape (local rows, nx)."""
        return np.full(self.local_shape, self.diagonal) + (
            0.0 if self.compliance is None else self.compliance
        )

    def view(self, mat, viewer):
        """Describe the operator for -ksp_view."""
        if viewer.getType() != PETSc.Viewer.Type.ASCII:
            return
        grid, kind = self.grid, type(self.product).__name__
        slabs = f"{self.slabs.size} slab{'s'[: self.slabs.size > 1]}"
        cells = f"{grid.nx} x {grid.ny} cells of {grid.dx:g} x {grid.dy:g} mm"
        viewer.printfASCII(f"  influence matrix of {cells}, {kind}, {slabs}\n")
