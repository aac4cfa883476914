"""Preconditioner for thin, nearly incompressible layers on a rigid base.

A long wave squeezes such a layer like a film of fluid. Its eigenvalue of A is about ``a + k q^2`` for wave numbers q
below the reciprocal of the thickness; a is 0 if the layer is incompressible. So A is nearly the operator L of a
membrane on springs, with p = 0 outside the contact set C. The inverse of A is not local, and the preconditioners for
half-spaces fail. The inverse symbol is the sum of two parts,

    1 / lambda = 1 / L(q) + R(q),   L(q) = a + k (2 - 2 cos q_x dx) / dx^2 + k (2 - 2 cos q_y dy) / dy^2

R is bounded for long waves, and grows like q for short waves. It is a product by FFT, or a constant if the layer is at
most a few cells thick. The preconditioner is C R C plus an approximate inverse of L on C, with p = 0 outside C. This
inverse is one V-cycle, which needs no Fourier transform:

- *Coarse grids.* Neighbours in C are connected by springs. A coarse cell consists of 2 x 2 cells. Springs between the
  same two coarse cells are added, and divided by 2, because the distance is twice as long. Springs to the ground, which
  stand for a and for the edge of C, are added. So holes and narrow contact spots act on all grids.
- *Smoother.* Damped Jacobi, with equally many sweeps before and after the coarse grid. So the cycle is symmetric.

Options::

    -pc_type python -pc_python_type app.methods.film.membrane.Membrane
"""

from dataclasses import replace
from functools import partial

import numpy as np
from petsc4py import PETSc

from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.operator import InfluenceOperator, get_operator
from app.methods.multilevel_operators import get_or_create
from app.multigrid.hierarchy import get_coarser_levels, make_transfers
from app.parallel.halo import Halo
from app.parallel.reductions import njit_reassoc
from app.parallel.slabs import none_if_single

SWEEPS, COARSEST_SWEEPS = 2, 40  # of the smoother before and after the coarse grid; on the coarsest grid
DAMPING = 0.8
SAMPLES = 32  # number of wave numbers in each direction at which R is sampled
MAX_CONSTANT_RATIO = 3.0  # largest over smallest R up to which a constant replaces it


@njit_reassoc
def _residual_row(x, above, below, b, springs, up, down, diagonal, out):
    last = x.size - 1
    for i in range(1, last):
        pulls = springs[i - 1] * x[i - 1] + springs[i] * x[i + 1]
        out[i] = b[i] - diagonal[i] * x[i] + pulls + up[i] * above[i] + down[i] * below[i]
    for i in (0, last):
        before, after = (last if i == 0 else i - 1), (0 if i == last else i + 1)
        pulls = springs[before] * x[before] + springs[i] * x[after]
        out[i] = b[i] - diagonal[i] * x[i] + pulls + up[i] * above[i] + down[i] * below[i]


@njit_reassoc
def _residual(x, before, after, b, in_x, in_y, first_up, diagonal, out):
    """Compute out = b - L x. `before` and `after` are the rows around x."""
    rows = x.shape[0]
    for j in range(rows):
        above = before[0] if j == 0 else x[j - 1]
        below = after[0] if j == rows - 1 else x[j + 1]
        up = first_up[0] if j == 0 else in_y[j - 1]
        _residual_row(x[j], above, below, b[j], in_x[j], up, in_y[j], diagonal[j], out[j])


class _MembraneLevel:
    """The operator L on the contact cells of one grid. Collective over the ranks of the grid.

    `in_x` and `in_y` are the stiffnesses of the springs to the next cell in x and y, `ground` of those to the ground.
    Outside contact the matrix and the inverse of its diagonal are 0.
    """

    def __init__(self, operator):
        grid, shape = operator.grid, operator.local_shape
        self._halo = Halo(operator.slabs, none_if_single(operator.comm), 1, grid.repeats[0])
        self._repeats_in_x = grid.repeats[1]
        self._none, self._out = np.zeros((1, grid.nx)), np.zeros(shape)

    def _around(self, field):
        return (rows if len(rows) else self._none for rows in self._halo(field))

    def set_springs(self, in_x, in_y, ground):
        """Set the springs; see the class."""
        self.in_x, self.in_y, self.ground = in_x, in_y, ground
        before, _ = self._around(in_y)
        self._up = np.array(before)
        above = np.concatenate([self._up, in_y])[:-1]
        self._diagonal = in_x + np.roll(in_x, 1, axis=1) + in_y + above + ground
        self.inverse = np.zeros_like(ground)
        np.divide(1.0, self._diagonal, out=self.inverse, where=self._diagonal > 0)

    def residual(self, x, b):
        """Return b - L x in a work array."""
        before, after = self._around(x)
        _residual(x, before, after, b, self.in_x, self.in_y, self._up, self._diagonal, self._out)
        return self._out

    def sweep(self, x, b, count):
        """Improve x by damped Jacobi sweeps."""
        for _ in range(count):
            r = self.residual(x, b)
            r *= self.inverse
            r *= DAMPING
            x += r

    def set_contact(self, contact, sides, ground):
        """Set the springs of the finest grid, of unit stiffness for square cells, and `ground` in each cell."""
        inside = contact.astype(float)
        _, after = self._around(inside)
        below = np.concatenate([inside, after])[1:]
        before, _ = self._around(inside)
        above = np.concatenate([before, inside])[:-1]
        right, left = np.roll(inside, -1, axis=1), np.roll(inside, 1, axis=1)
        if not self._repeats_in_x:
            right[:, -1] = left[:, 0] = 0.0
        y, x = sides
        edge = (2 - left - right) * (y / x) + (2 - above - below) * (x / y)
        self.set_springs(inside * right * (y / x), inside * below * (x / y), inside * (edge + ground))


class Membrane:
    """PC context for thin, nearly incompressible layers on a rigid base. Collective.

    The matrix A must be an `InfluenceOperator` of such a layer; see the module's docstring.
    """

    _operator = None

    def setUp(self, pc):
        """Prepare for a new operator or contact set."""
        operator = get_operator(pc.getOperators()[1], InfluenceOperator, "Membrane")
        if operator is not self._operator:
            self._operator, self._version = operator, -1
            if operator.kernel.film is None:
                raise ValueError(
                    "Membrane: the bodies must be layers on rigid bases, softer for shorter waves"
                )
            self._compliance, self._squeeze = operator.kernel.film
            self._rest = get_or_create(operator, "film", _create_rest)
            levels = [operator, *get_coarser_levels(operator)]
            self._levels, self._transfers = levels, make_transfers(levels[::-1], operator.comm)[:0:-1]
            self._membranes = [_MembraneLevel(level) if level.active else None for level in levels]
        if self._version != operator.contact_version:
            self._set_contact()
            self._version = operator.contact_version

    def reset(self, pc):
        """Drop the operator, so the next `setUp` prepares again."""
        self._operator = None

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            rest = "a constant" if isinstance(self._rest, _Constant) else "a product by FFT"
            viewer.printfASCII(f"  V-cycle for a membrane, on {len(self._levels)} grids, plus {rest}\n")

    def apply(self, pc, x, y):
        """Apply the preconditioner."""
        operator, shape = self._operator, self._operator.local_shape
        with y as out:
            z, r = out.reshape(shape), x.getArray(readonly=True).reshape(shape) * operator.mask
            self._rest.apply(r, z)
            z += self._cycle(0, r) * (operator.grid.cell_area / self._squeeze)
            z *= operator.mask

    applyTranspose = apply

    def _set_contact(self):
        operator, membranes = self._operator, self._membranes
        grid = operator.grid
        membranes[0].set_contact(
            operator.mask, (grid.dy, grid.dx), self._compliance / self._squeeze * grid.cell_area
        )
        springs = membranes[0].in_x, membranes[0].in_y, membranes[0].ground
        for membrane, transfer in zip(membranes[1:], self._transfers, strict=True):
            transfer.restrict_contact()
            springs = _coarsen(transfer, *springs)
            if membrane is not None:
                membrane.set_springs(*springs)

    def _cycle(self, level, b):
        """Return the V-cycle's approximation of L^-1 b. Collective."""
        membrane, last = self._membranes[level], level == len(self._levels) - 1
        x = np.zeros_like(b)
        if membrane is not None:
            membrane.sweep(x, b, COARSEST_SWEEPS if last else SWEEPS)
        if last:
            return x
        transfer = self._transfers[level]
        rest = membrane.residual(x, b) * (membrane.inverse > 0) if membrane is not None else x
        coarse = transfer.restrict_defect(rest)
        coarse *= transfer.fy * transfer.fx
        transfer.add_copies(self._cycle(level + 1, coarse), x)
        if membrane is not None:
            membrane.sweep(x, b, SWEEPS)
        return x


def _coarsen(transfer, in_x, in_y, ground):
    """Return the springs of the next coarser grid. Collective."""
    (ny, nx), rows, (fy, fx) = transfer.fine.grid.shape, transfer.fine.slabs.rows, transfer.factors
    row, column = np.arange(rows.start, rows.stop), np.arange(nx)
    across_y, across_x = ((i % f == f - 1) | (i == n - 1) for i, f, n in ((row, fy, ny), (column, fx, nx)))
    return (
        fy * transfer.restrict_defect(in_x * across_x),
        fx * transfer.restrict_defect(in_y * across_y[:, None]),
        fy * fx * transfer.restrict_defect(ground),
    )


class _Constant:
    """A multiple of the identity, with the interface of a multiplier."""

    points = 0

    def __init__(self, factor):
        self._factor = factor

    def apply(self, p, out):
        """Compute out = factor * p."""
        np.multiply(p, self._factor, out=out)


def _create_rest(grid, kernel, layout):
    """Return the product with R on all cells, for a patch continued periodically.

    If R is nearly constant, a constant replaces it.
    """
    kernel = kernel.base
    grid = grid if grid.doubly_periodic else replace(grid, periodic="love")
    compliance, squeeze = kernel.film

    def symbol(columns, rows):
        values = kernel.eigenvalues(grid, columns, rows)
        waves = ((index / n, d) for index, n, d in ((columns, grid.nx, grid.dx), (rows, grid.ny, grid.dy)))
        x, y = (squeeze * (2 * np.sin(np.pi * wave) / d) ** 2 for wave, d in waves)
        membrane = compliance + x[:, None] + y
        rest = np.zeros(values.shape)
        positive = (values > 0) & (membrane > 0)
        rest[positive] = 1 / values[positive] - 1 / membrane[positive]
        return np.maximum(rest, 0.0)

    few = [np.unique(np.linspace(min(1, n // 2), n // 2, SAMPLES).astype(int)) for n in (grid.nx, grid.ny)]
    samples = symbol(*few)
    if samples.max() <= MAX_CONSTANT_RATIO * samples.min():
        return _Constant(np.sqrt(samples.max() * samples.min()))
    rest = EvenMultiplier(grid.shape, grid.shape, layout)
    rest.load_or_make("film", partial(rest.set_spectrum, symbol))
    return rest
