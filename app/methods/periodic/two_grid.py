"""Preconditioner of O B O: sweeps with the centre of B for short waves, A on a coarser grid for long ones."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from app.contact import kernels
from app.halfspace.chebyshev import chebyshev_steps
from app.halfspace.operator import get_operator
from app.methods.periodic import stencil
from app.methods.periodic.operator import InverseOperator
from app.parallel.fetch import Fetch
from app.parallel.halo import Halo
from app.parallel.reductions import sum_over
from app.parallel.slabs import Slabs

_event = PETSc.Log.Event("TwoGridPC")
# Compliance of a constant, times E*, over the spacing of contact; and by the root of one and so many times the share of
# contact there long waves move less beside it. The second ones are for sweeps before the coarser grid, too.
CONSTANT_COMPLIANCE, CONSTANT_COMPLIANCE_PRESWEPT = 9.0, 12.0
CONTACT_STIFFNESS, CONTACT_STIFFNESS_PRESWEPT = 7.0, 5.0
DAMPED_EIGENVALUES = 0.5, 1.4  # eigenvalues of the centre of B, over B_00, that the sweeps are to damp ...
MIN_PRESWEPT_EIGENVALUE = (
    1.7  # highest one from which on sweeps precede the coarser grid, too; reached by 4:1 cells
)
DAMPED_FRACTION = 0.9  # ... and of the highest one, where sweeps would let it grow: on few rows of long cells
ROW_TOLERANCE = 1e-6  # of a coarse cell: so near to a row, the one beyond is at hand, too
_NO_WAVES, _NOWHERE = np.empty((0, 0)), ((1.0, 0.0), (1.0, 0.0))


class TwoGrid:
    """PC context; its operator must be an `InverseOperator`. Collective.

    The mean of s in coarse cells is multiplied by A on a grid of cells up to four times as long, and interpolated
    bilinearly. It is added to the first of some sweeps on the free cells with the 3 x 3 centre of B, which needs no
    neighbours; the others follow. Together they are steps of Chebyshev's. So M is positive, but symmetric only nearly.

    Sweeps do little for long cells, and on few rows what the coarser grid says of the highest waves is theirs, too.
    There sweeps come before, and the mean of what they leave is taken; in the other order they follow.

    A knows nothing of contact; but between contacts waves can move only as far as these let them, which hold the
    half-space as springs would, ``(B + stiffness)^-1``. As a flat punch does, each holds it by its perimeter: the
    compliance of a constant goes by the spacing of contacts, area over perimeter, and where little is free, less, by
    the root of its share. What is beside contact is held more than the rest: the field is divided, before A and after,
    by the root of one and a multiple of the share of contact in the coarse cells around.

    Options: ``-pc_two_grid_sweeps k`` (default 2), after the coarser grid.

    Attributes
    ----------
    stiffness : float
        B_00, the pressure that displaces a cell by 1 [(N/mm2) / mm].
    constrained : bool
        The mean of w must not change: results have none, and `multiplier` is the mean pressure that is missing.
    """

    operator = None
    sweeps = 2
    constrained = False
    multiplier = 0.0

    def setFromOptions(self, pc):
        """Read the options."""
        self.sweeps = PETSc.Options(pc.getOptionsPrefix()).getInt("pc_two_grid_sweeps", self.sweeps)
        if not 1 <= self.sweeps <= 50:
            raise ValueError(f"-pc_two_grid_sweeps {self.sweeps}: allowed: 1 to 50")
        self.reset(pc)

    def reset(self, pc):
        """Forget the operator; the next set-up takes that of the Mat."""
        self.operator = None

    def setUp(self, pc):
        """Make what depends on the grid alone, though PETSc calls for every contact set."""
        operator = get_operator(pc.getOperators()[1], InverseOperator, "TwoGrid")
        if operator is self.operator:
            return
        self.operator = operator
        self.weights = _weights(operator.product.centre, operator.grid)
        self.stiffness = 1.0 / self.weights[0]
        (low, high), highest = DAMPED_EIGENVALUES, _highest(*self.weights[1:])
        if highest > low + high:
            high = DAMPED_FRACTION * highest
        self._before, self._after = None, chebyshev_steps(1 + self.sweeps, low, high).astype(np.float32)
        springs = CONSTANT_COMPLIANCE, CONTACT_STIFFNESS
        if highest > MIN_PRESWEPT_EIGENVALUE:
            springs = CONSTANT_COMPLIANCE_PRESWEPT, CONTACT_STIFFNESS_PRESWEPT
            self._before = chebyshev_steps(self.sweeps, low, high).astype(np.float32)
            self._after = np.append(np.float32(0), self._before[::-1])
        self._rows = Halo(operator.slabs, operator.comm, self.sweeps)
        nx, kind = operator.grid.nx, np.float32
        self._room = stencil.make_room(1 + self.sweeps, nx)
        self._nothing = (np.empty((0, nx), kind),) * 3
        self._no_waves = _NO_WAVES, _NOWHERE, (np.empty(0, kind), np.empty(nx, kind))
        has_coarser = operator.coarser is not None
        self._long_waves = _LongWaves(operator, self.sweeps, springs) if has_coarser else None
        self._number, self._answer = -1, None  # of what contact set `_raised` is known

    def apply(self, pc, x, y):
        """Compute y = M x."""
        with y as out:
            shape = self.operator.local_shape
            self.smooth(x.getArray(readonly=True).reshape(shape), out.reshape(shape))

    def smooth(self, s, z):
        """Compute z = M s on the free cells, zero elsewhere. Collective; z of float64 or float32."""
        self._look_at_contact()
        with _event:
            self._apply(s, z)
        if self.constrained:
            total = sum_over(self.operator.comm, [z.sum(dtype=float)])[0]
            raised, of_raised = self._raised()
            share = total / of_raised if of_raised > 0 else 0.0
            self.multiplier = share * self.stiffness
            z -= share * raised

    def shift(self, amount, *fields):
        """Raise fields on the free cells, smoothly, until their sums have changed by an amount. Collective."""
        self._look_at_contact()
        raised, of_raised = self._raised()
        for field in fields if of_raised > 0 else ():
            field += amount / of_raised * raised

    def _look_at_contact(self):
        """Fetch the free cells beside the slab, once for a contact set. Collective."""
        if self._number != self.operator.contact_version:
            self._number, self._answer = self.operator.contact_version, None
            mask, grid = self.operator.mask, self.operator.grid
            self._free = before, _ = self._rows(mask)
            last = before[-1] if len(before) else np.zeros(grid.nx, bool)
            counts = *kernels.count_faces(mask, last, True), np.count_nonzero(mask)
            in_x, in_y, cells = sum_over(self.operator.comm, counts)
            perimeter = max(in_x * grid.dy + in_y * grid.dx, min(grid.dx, grid.dy))
            if self._long_waves and cells:
                self._long_waves.look_at(mask, cells / grid.n, grid.area / perimeter)

    def _raised(self):
        """What M makes of the pressure B_00 everywhere, and its sum, once for a contact set. Collective."""
        if self._answer is None:
            raised = np.empty(self.operator.local_shape)
            even = np.full_like(raised, self.stiffness)  # of any unit, 1 in single precision
            even.flags.writeable = False  # as pressures are
            self._apply(even, raised)
            self._answer = raised, sum_over(self.operator.comm, [raised.sum()])[0]
        return self._answer

    def _apply(self, s, z):
        free, waves, no_waves = self.operator.mask, self._long_waves, self._no_waves
        inside = s, *self._rows(s), free, *self._free, self.weights
        x = self._nothing
        if self._before is not None:
            swept = z if z.dtype == np.float32 else np.empty(z.shape, np.float32)
            stencil.sweep(*inside, self._before, *x, *no_waves, swept, self._room)
            x = swept, *self._rows(swept)
        found = waves.of(s, free, self.weights, *x) if waves else no_waves
        stencil.sweep(*inside, self._after, *x, *found, z, self._room)

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            if self._before is None:
                sweeps, place = f"{1 + self.sweeps} sweeps with the centre of B", "added to the first"
            else:
                sweeps, place = f"twice {self.sweeps} sweeps with the centre of B", "between them"
            coarse = self._long_waves.coarse.grid if self._long_waves else None
            more = f", A on {coarse.nx} x {coarse.ny} cells {place}" if coarse else ""
            viewer.printfASCII(f"  {sweeps}{more}\n")


def _weights(centre, grid):
    """Of the sweeps, see `stencil`: each other cell counts once, though it may be the neighbour on both sides."""
    in_y, in_x = (min(n - 1, 2) / 2 for n in (grid.ny, grid.nx))
    around = centre[1, 0] * in_x, centre[0, 1] * in_y, centre[0, 0] * in_x * in_y
    middle = float(centre[1, 1]) or 1.0  # B of a single cell is zero
    return 1.0 / middle, *(np.float32(value / middle) for value in around)


def _highest(x, y, diagonal):
    """Eigenvalue of the sweeps' stencil: of the waves that alternate from cell to cell in x, in y, or in both."""
    alternating = (x - y - 2 * diagonal, y - x - 2 * diagonal, 2 * diagonal - x - y)
    return 1 + 2 * float(max(alternating))


def _factor(n, coarse):
    """Cells in a coarse one, a power of two, of so many that are made of n."""
    factor = 1
    while -(-n // factor) > coarse:
        factor *= 2
    return factor


class _LongWaves:
    """A on a coarser grid, for what sweeps do not reach.

    Slabs may begin inside of a coarse row: it is made where its first row is, with what the next ranks have of it.
    """

    def __init__(self, fine, width, springs):
        self.coarse, (self._of_constant, self._of_contact) = fine.coarser, springs
        coarse = self.coarse
        self._factors = fy, _ = tuple(map(_factor, fine.grid.shape, coarse.grid.shape))
        made, comm = fine.slabs.coarsen(fy), fine.comm
        ranks, rank = (1, 0) if comm is None else (comm.size, comm.rank)
        first, last = fine.slabs.bounds(ranks)
        some, self._skipped = last > first, int(first[rank] % fy)
        low, high = first // fy, np.where(some, -(-last // fy), first // fy)
        self._left = np.empty((high[rank] - low[rank], coarse.grid.nx))
        self._to_coarse = Fetch(made, [coarse.slabs.bounds(ranks)], comm)
        (ay, by), in_x = fine.grid.places_in(coarse.grid)
        above = np.floor(ay * (first - width) + by - ROW_TOLERANCE).astype(int)
        below = np.floor(ay * (last - 1 + width) + by + ROW_TOLERANCE).astype(int) + 2
        self._around = Fetch(coarse.slabs, [(above, np.where(some, below, above))], comm)
        self._places = (ay, ay * (first[rank] - width) + by - above[rank]), in_x
        # Of each coarse row, how many ranks begin inside; they follow the one that makes it.
        inside = np.bincount(low[some & (first % fy > 0)], minlength=coarse.grid.ny)
        begin, end = made.bounds(ranks)
        number = np.where(end > begin, inside[end - 1], 0)
        following = np.arange(1, ranks + 1)
        self._rest = Fetch(Slabs(ranks, ranks, rank), [(following, following + number)], comm)
        self._beside = Halo(coarse.slabs, comm, 1)
        self._u, self._held = np.empty(coarse.local_shape), np.ones(coarse.local_shape)
        nx, kind = fine.grid.nx, np.float32  # rows that one loop after the other works in
        self._row, self._wide = np.empty(nx, kind), np.empty(coarse.grid.nx + 2, kind)
        self._three = np.empty((3, nx + 2), kind)

    def look_at(self, free, share, spacing):
        """Let contact hold the long waves: the share that is free, and the spacing of contact [mm]. Collective."""
        coarse = self.coarse
        stencil.contact_in_cells(free, self._left, self._skipped, self._factors, self._row)
        contact = self._on_coarse()
        before, after = self._beside(contact)
        beside = _smoothed(np.concatenate([before, contact, after]))
        self._held = 1 / np.sqrt(1 + self._of_contact * share * beside)
        if coarse.active:
            compliance = np.pi * coarse.compliance  # 1 / E*
            coarse.screened_product.screen(1 / (self._of_constant * compliance * np.sqrt(share) * spacing))

    def of(self, s, free, weights, x, *beside):
        """A on springs times s on the free cells, or what sweeps to x left, for `stencil.sweep`. Collective."""
        place = self._left, self._skipped, self._factors
        if x.size:
            stencil.left_in_cells(s, free, weights, x, *beside, *place, self._three, self._row)
        else:
            stencil.free_in_cells(s, free, weights[0], *place, self._row)
        left = self._held * self._on_coarse()
        if self.coarse.active:
            product = self.coarse.screened_product
            product.apply(left, self._u)
            PETSc.Log.logFlops(product.flops)
        self._u *= self._held / weights[0]
        return self._around(self._u), self._places, (self._wide, self._row)

    def _on_coarse(self):
        """Bring what was summed in coarse cells to the ranks of the coarse grid. Collective."""
        left, rest = self._left[bool(self._skipped) :], self._rest(self._left[:1])
        if len(rest):
            left[-1] += rest.sum(axis=0)
        return self._to_coarse(left)


def _smoothed(field):
    """Binomial means over 3 x 3 cells, but for the first row and the last; columns wrap around."""
    field = (field[:-2] + 2 * field[1:-1] + field[2:]) / 4
    return (np.roll(field, 1, axis=1) + 2 * field + np.roll(field, -1, axis=1)) / 4
