"""Preconditioner ``C B C`` on the contact set C.

As a matrix, C sets cells outside the contact set to zero. B is the inverse of the periodic continuation of A. On a
periodic patch A itself is circulant, and B is computed by FFT. A free patch is continued periodically with a gap
between its copies. On large grids B is then a multilevel product, which takes a third of the time of an FFT
(`app.methods.multilevel_operators`). The eigenvalues 1 / lambda of B (`app.methods.symbol`) are positive. The periodic
matrix of the zero-padded grid has negative eigenvalues and cannot be used.

The residual may be extended past the contact edge before B is applied, see `Circulant`. The preconditioner is used on
the target grid, or as a multigrid smoother, which must be damped (``-mg_levels_ksp_richardson_scale``)::

    -pc_type python -pc_python_type app.methods.free.circulant.Circulant
    -mg_levels_pc_type python -mg_levels_pc_python_type app.methods.free.circulant.Circulant
"""

from functools import partial

import numpy as np
from petsc4py import PETSc

from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.operator import InfluenceOperator, get_operator
from app.methods.free.block_average import BlockAverage
from app.methods.free.contact_edge import EdgeExtension
from app.methods.free.padded_inverse import PaddedInverse
from app.methods.multilevel_operators import create_circulant_inverse, get_or_create
from app.methods.symbol import centre

_event = PETSc.Log.Event("CirculantPC")
MIN_BLOCKS = 8  # in a direction: on smaller grids block means gain nothing
STIFF_LAYER_STEPS = 3  # factor on the extension's steps for a stiff layer on a soft substrate
MIN_STIFF_CONTRAST = 1.25  # least ratio of the compliances for long and short waves of such a layer
MAX_NEIGHBOUR_SHARE = 0.9  # of the stencil's centre: the neighbours' sum, or the steps would diverge
MAX_SCALED_ASPECT = (
    1.75  # side ratio of cells up to which the stencil keeps constants; above, contact sets cycle
)


def _create_periodic_inverse(grid, kernel, layout):
    """Return the inverse of the influence matrix A of a periodic patch.

    The eigenvalue of A for constants, 0, is replaced by the eigenvalue for the longest wave.
    """
    eigenvalues = partial(kernel.eigenvalues, grid)
    longest = eigenvalues(np.arange(min(2, grid.nx)), np.arange(min(2, grid.ny))).max() or 1.0

    def symbol(columns, rows):
        values = eigenvalues(columns, rows)
        return 1 / np.where(values > 0, values, longest)

    inverse = EvenMultiplier(grid.shape, grid.shape, layout)
    inverse.load_or_make("inverse", partial(inverse.set_spectrum, symbol))
    return inverse


def circulant_inverse(operator, apart=False, padded=False):
    """Return B, the inverse of A's periodic continuation.

    Collective over the ranks of the `operator`. B is created on first use. On a periodic patch B is exact. If `apart`
    is true, there is a gap between the copies of a free patch, as in `create_circulant_inverse`. If `padded` is true,
    too, fields are continued past the boundary of a free patch, as in `PaddedInverse`.
    """
    if not operator.active:
        return operator.product
    periodic = operator.grid.doubly_periodic
    if padded:
        return get_or_create(operator, "apart", PaddedInverse)
    create = _create_periodic_inverse if periodic else partial(create_circulant_inverse, apart=apart)
    return get_or_create(operator, "apart" if apart and not periodic else "adjoining", create)


class Circulant:
    """Preconditioner ``C E^T B E C`` on contact, as a PC context.

    Collective. The matrix A must be an `InfluenceOperator`. C restricts fields to contact, and B is the inverse of A
    after periodic continuation of the patch. By default E = 1. With k > 0, E extends the residual past the contact edge
    by k steps of an iteration with the 3 x 3 centre of B (`app.methods.free.contact_edge`). The iteration starts from
    zero or, on a free patch with scattered contact, from means of the residual over blocks
    (`app.methods.free.block_average`).

    For a stiff layer on a soft substrate, B also continues fields past the boundary of a free patch
    (`app.methods.free.padded_inverse`), and E takes 3 k steps.

    If cells have a compliance D of their own (`InfluenceOperator.compliance`), the matrix is A + D. Bodies and springs
    are in series: ``r.(A + D)^-1 r`` is the least ``v.A^-1 v + z.D^-1 z`` with v + z = r. So with any share T of r on
    the bodies, ``T A^-1 T + (1 - T) D^-1 (1 - T)`` is at least the inverse. It is the preconditioner, with the above in
    place of A^-1 and ``T = m / (m + D)``. Here m is the geometric mean of A's eigenvalues for the longest and the
    shortest waves. If D is constant, the condition number is at most about a quarter of the root of their ratio.

    Options: ``-pc_circulant_extend k``, the number of steps (default 0: E = 1); ``-pc_circulant_blocks n``, the cells
    of a block in each direction (default 0: no block means).
    """

    operator = None
    steps = blocks = 0

    def setFromOptions(self, pc):
        """Read the numbers of extension steps and block cells from the options."""
        options = PETSc.Options(pc.getOptionsPrefix())
        self.steps = options.getInt("pc_circulant_extend", self.steps)
        self.blocks = options.getInt("pc_circulant_blocks", self.blocks)
        self.reset(pc)

    def reset(self, pc):
        """Drop the operator, so the next `setUp` prepares again."""
        self.operator = None

    def setUp(self, pc):
        """Prepare for a new operator; PETSc calls it for each contact set."""
        operator = get_operator(pc.getOperators()[1], InfluenceOperator, "Circulant")
        if operator is self.operator:
            return
        self.operator = operator
        grid, kernel = operator.grid, operator.kernel
        blocks, periodic, contrast = self.blocks, grid.doubly_periodic, kernel.contrast(grid)
        self._compliance = None
        if periodic and operator.compliance is not None:
            blocks = 0
        has_stiff_layer = not grid.doubly_periodic and contrast > MIN_STIFF_CONTRAST
        self.multiplier = circulant_inverse(operator, apart=True, padded=has_stiff_layer)
        shared = operator.slabs, operator.comm
        steps = self.steps * (STIFF_LAYER_STEPS if has_stiff_layer else 1)
        self.extension = EdgeExtension(operator.local_shape, *shared, steps, grid.periodic)
        stencil = self.multiplier.centre if periodic else centre(grid, kernel)
        if has_stiff_layer and stencil.sum() < (1 - MAX_NEIGHBOUR_SHARE) * stencil[1, 1]:
            stencil = _scale_neighbours(stencil, MAX_NEIGHBOUR_SHARE)
        self.average = None
        if blocks < 0 or (blocks and periodic):
            raise ValueError(f"-pc_circulant_blocks {blocks}: allowed: from 0, and 0 on periodic patches")
        if blocks and kernel.far_reaching and min(grid.shape) >= MIN_BLOCKS * blocks:
            self.average = BlockAverage(grid.shape, *shared, blocks, contrast)
        sides = grid.dx, grid.dy
        # Without block means neighbours may cancel, as on 2 x 2 periodic cells.
        scaled = self.average and max(sides) <= MAX_SCALED_ASPECT * min(sides)
        self._stencils = stencil, _scale_neighbours(stencil, 1.0) if scaled else stencil
        self._scattered = False
        self.extension.set_stencil(stencil)
        self._contact_version = -1  # version of the contact set that the extension has

    def apply(self, pc, x, y):
        """Apply the preconditioner: y = C E^T B E C x.

        C sets cells outside the contact set to zero, E extends the residual past the contact edge, and B is the inverse
        of A continued periodically.
        """
        operator = self.operator
        shape = operator.local_shape
        with y as out:
            r, z = x.getArray(readonly=True).reshape(shape), out.reshape(shape)
            np.multiply(r, operator.mask, out=z)
            self.precondition(z, z)
            z *= operator.mask

    def precondition(self, r, z, reduced=None):
        """Apply the preconditioner to a residual on contact.

        The result is z = E^T B E r, with the extension E of `Circulant` and the periodic inverse B of A. Outside
        contact r must be zero, and z is arbitrary. Both are float64 or float32, and may be the same array. To save a
        sum over ranks, pass ``reduced = (share, terms)`` if r is the residual of the last call minus share * q on the
        same contact set; `terms` is the sum of `local_terms(q)` over the ranks. Return r.z if it needs no extra work,
        otherwise None.
        """
        with _event:
            PETSc.Log.logFlops(self.multiplier.flops)
            if self.operator.compliance is not None:
                return self._precondition_springs(r, z, reduced)
            return self._precondition_bodies(r, z, reduced)

    def _precondition_bodies(self, r, z, reduced):
        self._extend(r, z, reduced)
        self.multiplier.apply(z, z, rows=self.extension.rows)
        self.extension.restrict(z)
        if not self._scattered:
            return None
        product = self.average.apply_transpose(r, z)
        return None if r is z else product

    def _precondition_springs(self, r, z, reduced):
        share, springs = self._shares()
        rest, bodies = springs * r, share * r
        self._precondition_bodies(bodies, z, reduced)
        z *= share
        z += rest

    def _shares(self):
        """Return the share T of the bodies, and the factor (1 - T)^2 / D of the springs."""
        operator = self.operator
        if self._compliance is not operator.compliance:  # a window may have moved
            self._compliance = operator.compliance
            grid, kernel, compliance = operator.grid, operator.kernel, operator.compliance
            middle = np.sqrt(kernel.middle_displacement(grid.sides[::-1]) * kernel.smallest_eigenvalue(grid))
            share = middle / (middle + compliance)
            weights = share, compliance * (share / middle) ** 2
            self._weights = [weight.astype(operator.dtype) for weight in weights]
        return self._weights

    def local_terms(self, q):
        """Return means of the field q over blocks of this rank's rows, for `precondition`.

        The result is empty on a single rank, and if no block means are used.
        """
        if not self._scattered or self.operator.comm is None:
            return ()
        if self.operator.compliance is not None:
            q = self._shares()[0] * q
        return self.average.local_means(q)

    def extend(self, r):
        """Continue a residual r past the contact edge, in place: r = E T r."""
        if self.operator.compliance is not None:
            r *= self._shares()[0]
        self._extend(r)

    def _extend(self, r, out=None, reduced=None):
        """Extend the residual r past the contact edge: out = E r.

        E does not change r on contact. It continues r outside by steps with the 3 x 3 centre of B
        (`app.methods.free.contact_edge`). Without `out`, the result replaces r. For `reduced` see `precondition`.
        """
        out = r if out is None else out
        if self._contact_version != self.operator.contact_version:
            self._set_contact(r)
        elif self._scattered and reduced:
            self.average.subtract(*reduced)
        elif self._scattered:
            self.average.update(r)
        if self._scattered:
            self.average.extend(r, out)
            r = out
        self.extension.extend(r, out)

    def _set_contact(self, r):
        """Adapt E and the block means to a new contact set.

        Block means are used if contact is scattered; `r` is the residual.
        """
        before, extension, average = self._scattered, self.extension, self.average
        self._contact_version = self.operator.contact_version
        extension.set_contact(self.operator.mask)
        # If the last set was scattered this one probably is: then one reduction does both.
        self._scattered = average is not None and average.set_contact(
            extension.contact, r if before else None
        )
        if self._scattered != before:
            extension.set_stencil(self._stencils[self._scattered])
        if self._scattered:
            extension.include_all_rows()
            if not before:
                average.update(r)

    applyTranspose = apply

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            ny, nx = self.multiplier.periods
            in_y, in_x = self.operator.grid.repeats
            sides = " and ".join(["x"] * (not in_x) + ["y"] * (not in_y))
            matrix = f"A continued periodically in {sides}" if sides else "the periodic A"
            begin = ", from means over blocks" if self.average else ""
            extended = f"residual extended by {self.extension.steps} cells{begin}"
            viewer.printfASCII(f"  inverse of {matrix}, periods {nx} x {ny}; {extended}\n")


def _scale_neighbours(stencil, share):
    """Scale stencil neighbours to the sum -`share` * centre."""
    middle = stencil[1, 1]
    scaled = stencil * (share * middle / (middle - stencil.sum()))
    scaled[1, 1] = middle
    return scaled
