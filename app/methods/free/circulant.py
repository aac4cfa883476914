"""Preconditioner: the inverse of A, continued periodically, restricted to the contact set: ``C B C``.

On a periodic patch A is a circulant matrix itself, inverted by FFT. A free patch is continued periodically, at some
distance from itself; on large grids its B is made of stencils on several grids and an FFT on the coarsest, in a third
of the time (`levels`). With its eigenvalues 1 / lambda (`symbol`) it is positive definite; the periodic matrix of
the zero-padded grid has negative ones, and is of no use.

The residual may be extended over the rim of the contact set first, see `Circulant`. Usable wherever PETSc takes a PC,
on the target grid and as a multigrid smoother, where it must be damped (``-mg_levels_ksp_richardson_scale``)::

    -pc_type python -pc_python_type app.methods.free.circulant.Circulant
    -mg_levels_pc_type python -mg_levels_pc_python_type app.methods.free.circulant.Circulant
"""

from __future__ import annotations

from functools import partial

import numpy as np
from petsc4py import PETSc

from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.operator import InfluenceOperator, get_operator
from app.halfspace.periodic_symbol import influence_symbol
from app.methods import multilevel_operators
from app.methods.free.block_average import BlockAverage
from app.methods.free.contact_edge import EdgeExtension
from app.methods.multilevel_operators import create_circulant_inverse, get_or_create
from app.methods.symbol import centre

_event = PETSc.Log.Event("CirculantPC")
MIN_BLOCKS = 8  # blocks in a direction; on smaller grids they gain nothing
MAX_SCALED_ASPECT = (
    1.75  # ratio of the sides of cells up to which a constant stays one; else contact sets cycle
)


def _periodic_inverse(grid, compliance, layout):
    """The inverse of A itself; a constant pressure, which displaces nothing, is as soft as the softest wave."""
    eigenvalues = partial(influence_symbol, grid, compliance)
    longest = eigenvalues(np.arange(min(2, grid.nx)), np.arange(min(2, grid.ny))).max() or 1.0

    def symbol(columns, rows):
        found = eigenvalues(columns, rows)
        return 1 / np.where(found > 0, found, longest)

    inverse = EvenMultiplier(grid.shape, grid.shape, layout)
    inverse.use(layout.spectra, "inverse", partial(inverse.set_spectrum, symbol))
    return inverse


def circulant_inverse(operator, apart=False):
    """Return B on the grid of an operator, created on first use.

    Collective over its ranks. On a periodic patch B is exact. `apart`: see `create_circulant_inverse`.
    """
    if not operator.active:
        return operator.product
    periodic = operator.grid.periodic
    make = _periodic_inverse if periodic else partial(create_circulant_inverse, apart=apart)
    return get_or_create(operator, "apart" if apart and not periodic else "adjoining", make)


def prepare(grid):
    """Prepare what preconditioners on a free grid, and in windows of it, need. Not collective."""
    centre(grid)
    multilevel_operators.prepare(grid)


class Circulant:
    """PC context ``C E^T B E C``; its operator must be an `InfluenceOperator`.

    B takes the residual for zero outside the contact set, which it is not; E extends it over the rim by k steps
    with the 3 x 3 centre of B (see `app.methods.free.contact_edge`), from zero or, on a free patch where
    contact is scattered, from
    means over blocks (`app.methods.free.block_average`): then the centre is taken so that a constant stays
    one, if cells are not stretched.

    Options: ``-pc_circulant_extend k`` (default 0: E = 1), ``-pc_circulant_blocks cells`` (default 0: from zero).
    """

    operator = None
    steps = blocks = 0

    def setFromOptions(self, pc):
        """Read the options."""
        options = PETSc.Options(pc.getOptionsPrefix())
        self.steps = options.getInt("pc_circulant_extend", self.steps)
        self.blocks = options.getInt("pc_circulant_blocks", self.blocks)
        self.reset(pc)

    def reset(self, pc):
        """Forget the operator; the next set-up takes that of the Mat."""
        self.operator = None

    def setUp(self, pc):
        """Find the operator; what depends on the grid alone is made once, though PETSc calls for every contact set."""
        operator = get_operator(pc.getOperators()[1], InfluenceOperator, "Circulant")
        if operator is self.operator:
            return
        self.operator = operator
        blocks, periodic = self.blocks, bool(operator.grid.periodic)
        self.multiplier = circulant_inverse(operator, apart=True)
        self.extension = EdgeExtension(
            operator.local_shape, operator.slabs, operator.comm, self.steps, periodic
        )
        stencil = self.multiplier.centre if periodic else centre(operator.grid)
        self.between = None
        if blocks < 0 or (blocks and periodic):
            raise ValueError(f"-pc_circulant_blocks {blocks}: allowed: from 0, and 0 on periodic patches")
        if blocks and min(operator.grid.shape) >= MIN_BLOCKS * blocks:
            self.between = BlockAverage(operator.grid.shape, operator.slabs, operator.comm, blocks)
        sides = operator.grid.dx, operator.grid.dy
        square = max(sides) <= MAX_SCALED_ASPECT * min(sides)
        # On a periodic patch there are no blocks, and neighbours may cancel out, as on 2 x 2 cells.
        scattered = _of_sum_zero(stencil) if square and self.between is not None else stencil
        self._stencils = stencil, scattered
        self._scattered = False
        self.extension.set_stencil(stencil)
        self._contact = -1  # number of the set that the extension knows

    def apply(self, pc, x, y):
        """Compute y = C E^T B E C x."""
        operator = self.operator
        shape = operator.local_shape
        with y as out:
            r, z = x.getArray(readonly=True).reshape(shape), out.reshape(shape)
            np.multiply(r, operator.mask, out=z)
            self.precondition(z, z)
            z *= operator.mask

    def precondition(self, r, z, reduced=None):
        """Compute z = E^T B E r on C, whatever elsewhere. Collective.

        Parameters
        ----------
        r, z : ndarray of float64 or float32, shape `local_shape`
            May be one; r vanishes outside C.
        reduced : (float, ndarray), optional
            If r is that of the last call on this contact set less a share of q: the share, and `local_terms` of q,
            summed over the ranks. It saves a reduction.

        Returns
        -------
        float or None
            r.z, if they are two and it costs nothing.
        """
        with _event:
            PETSc.Log.logFlops(self.multiplier.flops)
            self.extend(r, z, reduced)
            self.multiplier.apply(z, z, rows=self.extension.rows)
            self.extension.restrict(z)
            if not self._scattered:
                return None
            product = self.between.apply_transpose(r, z)
            return None if r is z else product

    def local_terms(self, q):
        """What `precondition` has to know, summed over the ranks, of that by which r is reduced. Not collective.

        Nothing, where there are no others: a look at r costs less then.
        """
        return self.between.local_means(q) if self._scattered and self.operator.comm is not None else ()

    def extend(self, r, out=None, reduced=None):
        """Continue a residual that is zero outside C over the rim, see `EdgeExtension.extend`. Collective.

        `reduced`: see `precondition`.
        """
        out = r if out is None else out
        if self._contact != self.operator.contact_version:
            self._take_contact(r)
        elif self._scattered and reduced:
            self.between.subtract(*reduced)
        elif self._scattered:
            self.between.update(r)
        if self._scattered:
            self.between.extend(r, out)
            r = out
        self.extension.extend(r, out)

    def _take_contact(self, r):
        """Look at another contact set, and a residual on it. Collective."""
        before, extension, means = self._scattered, self.extension, self.between
        self._contact = self.operator.contact_version
        extension.set_contact(self.operator.mask)
        at_once = r if before else None  # if the last set was scattered, this one will be, too
        self._scattered = means is not None and means.set_contact(extension.contact, at_once)
        if self._scattered != before:
            extension.set_stencil(self._stencils[self._scattered])
        if self._scattered and not before:
            means.update(r)
        if self._scattered:
            extension.include_all_rows()

    applyTranspose = apply

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            ny, nx = self.multiplier.periods
            steps = self.extension.steps
            begin = ", from means over blocks" if self.between else ""
            viewer.printfASCII(
                f"  inverse of A continued periodically, periods {nx} x {ny}, extended by {steps} cells{begin}\n"
            )


def _of_sum_zero(stencil):
    """The same with other neighbours, in proportion: it makes nothing of a constant."""
    middle = stencil[1, 1]
    scaled = stencil * (middle / (middle - stencil.sum()))
    scaled[1, 1] = middle
    return scaled
