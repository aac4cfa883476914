"""Two-grid preconditioner of O B O, the matrix of the periodic method.

O restricts fields to the free cells, those outside the contact set. B is the inverse of the influence matrix A. So a
product with A on a coarser grid nearly solves for the long waves. Sweeps on the free cells reduce the short waves.
"""

from functools import lru_cache

import numpy as np
from petsc4py import PETSc

from app.base.numba_cache import as_writable
from app.contact import loops
from app.halfspace.chebyshev import chebyshev_steps
from app.halfspace.grid import Grid
from app.halfspace.kernel import UNIT
from app.halfspace.operator import get_operator
from app.methods.periodic import stencil
from app.methods.periodic.operator import InverseOperator
from app.parallel.fetch import Fetch
from app.parallel.halo import Halo
from app.parallel.reductions import sum_over
from app.parallel.slabs import Slabs

_event = PETSc.Log.Event("TwoGridPC")
CONSTANT_COMPLIANCE, CONSTANT_COMPLIANCE_PRESWEPT = (
    9.0,
    12.0,
)  # compliance of constants times E* over contact spacing
CONTACT_STIFFNESS, CONTACT_STIFFNESS_PRESWEPT = (
    7.0,
    5.0,
)  # reduction of long waves, over the share of contact around
# If long waves are more compliant than short ones, the contact springs are stiffer by a power of the ratio.
STIFFENING_WAVE_CELLS = 8.0, 96.0  # lengths of the two waves
STIFFENING_POWER, MAX_STIFFENING = 1.25, 5.0
# With stiffened springs, the compliance is that of this wave instead of a wave as long as the contact spacing.
CONSTANT_WAVE_CELLS = 48.0
DAMPED_EIGENVALUES = 0.5, 1.4  # interval of eigenvalues of the centre of B, over B_00, that the sweeps damp
DAMPED_FRACTION = (
    0.9  # upper end over the largest eigenvalue, if that would be amplified: on few rows of long cells
)
# Lengths of waves: the weights of a layered body are right for the one with the larger eigenvalue.
LONG_WAVE_CELLS = 24.0, 96.0
HALF_SPACE_WAVE_CELLS = 18.0  # length of the wave for which the weights of a half-space are right
WEIGHT_FACTORS = 0.5, 2.0  # least and largest factor on the weights of a layered body
SAMPLE_CELLS = 16  # largest number of cells, along an axis, of the grid for the weights of a half-space
MISSED_WAVE_CELLS = 8.0  # length of the shortest waves that the coarser grid has
MAX_STEEP_EIGENVALUE = 0.6  # of these waves over that of a half-space, below which there is one more sweep
MIN_DAMPED_EIGENVALUE = 0.2  # smallest lower end of the damped interval
MAX_EXCESS = 0.8  # largest eigenvalue minus the upper end, over the lower end; waves are amplified from 1 on
MIN_PRESWEPT_EIGENVALUE = 1.7  # largest eigenvalue above which sweeps also come first; 4:1 cells reach it
ROW_TOLERANCE = 1e-6  # in coarse cells: a row this near to a coarse row also fetches the next one
_NO_WAVES, _NOWHERE = np.empty((0, 0)), ((1.0, 0.0), (1.0, 0.0))


class TwoGrid:
    """Two-grid preconditioner M of O B O, as a PC context. Collective.

    O restricts fields to the free cells, B is the inverse of A, and M s is an approximate displacement for a residual
    pressure s. The means of s over coarse cells, up to four times as long, are multiplied by A on the coarse grid and
    interpolated bilinearly. The result is added after the first of several sweeps on the free cells with the 3 x 3
    centre of B. The sweeps have Chebyshev's step lengths. So M is positive, but not quite symmetric.

    If cells are long, or if there are few rows, there are also sweeps before the coarser grid. The coarser grid then
    gets the means of their residual, and the sweeps after it are in reversed order.

    A does not include contact, which holds the half-space like springs. So A is replaced by ``(B + stiffness)^-1``, and
    the long waves are reduced near contact. The stiffness of the springs follows from the area and the perimeter of
    contact.

    Option: ``-pc_two_grid_sweeps k``, the number of sweeps after the coarser grid (default 2).

    Attributes
    ----------
    stiffness : float
        B_00, the pressure that displaces a cell by 1 mm [(N/mm2) / mm].
    constrained : bool
        True if the mean of w must not change, so that results have mean zero.
    multiplier : float
        Constant that was subtracted from s to get mean zero; a change of the mean pressure [N/mm2].
    """

    operator = None
    sweeps = 2
    constrained = False
    multiplier = 0.0

    def setFromOptions(self, pc):
        """Read the number of sweeps from the options."""
        self.sweeps = PETSc.Options(pc.getOptionsPrefix()).getInt("pc_two_grid_sweeps", self.sweeps)
        if not 1 <= self.sweeps <= 50:
            raise ValueError(f"-pc_two_grid_sweeps {self.sweeps}: allowed: 1 to 50")
        self.reset(pc)

    def reset(self, pc):
        """Drop the operator, so the next `setUp` prepares again."""
        self.operator = None

    def setUp(self, pc):
        """Prepare for a new operator; PETSc calls it for each contact set."""
        operator = get_operator(pc.getOperators()[1], InverseOperator, "TwoGrid")
        if operator is self.operator:
            return
        self.operator = operator
        self.weights = _weights(operator.influence.kernel, operator.product.centre, operator.grid)
        self.stiffness = 1.0 / self.weights[0]
        (low, high), (_, x, y, diagonal) = DAMPED_EIGENVALUES, self.weights
        # On stiff coatings waves that the coarser grid just misses have smaller eigenvalues.
        smaller = _relative_eigenvalue(
            operator.influence.kernel, self.stiffness, operator.grid, MISSED_WAVE_CELLS
        )
        low = max(low * min(smaller, 1.0), MIN_DAMPED_EIGENVALUE)
        sweeps = self._applied_sweeps = self.sweeps + (smaller < MAX_STEEP_EIGENVALUE)
        # Extreme eigenvalues of the sweeps, of constants and of waves that alternate in x, y or both.
        waves = x + y + 2 * diagonal, x - y - 2 * diagonal, y - x - 2 * diagonal, 2 * diagonal - x - y
        highest = 1 + 2 * float(max(waves))
        low = max(low, 1 + 2 * float(min(waves)))  # or sweeps reverse long waves on thin layers
        if smaller < 1:
            high = max(high, highest - MAX_EXCESS * low)
        elif highest > low + high:
            high = DAMPED_FRACTION * highest
        self._before, self._after = None, chebyshev_steps(1 + sweeps, low, high).astype(np.float32)
        springs = CONSTANT_COMPLIANCE, CONTACT_STIFFNESS
        stiffening = _stiffening(operator.influence.kernel, operator.grid)
        if highest > MIN_PRESWEPT_EIGENVALUE:
            springs, stiffening = (CONSTANT_COMPLIANCE_PRESWEPT, CONTACT_STIFFNESS_PRESWEPT), 1.0
            self._before = chebyshev_steps(sweeps, low, high).astype(np.float32)
            self._after = np.append(np.float32(0), self._before[::-1])
        self._rows = Halo(operator.slabs, operator.comm, sweeps)
        nx, kind = operator.grid.nx, np.float32
        self._work = stencil.make_work(1 + sweeps, nx)
        self._zero = (np.empty((0, nx), kind),) * 3
        self._no_waves = _NO_WAVES, _NOWHERE, (np.empty(0, kind), np.empty(nx, kind))
        has_coarser = operator.coarser is not None
        self._long_waves = _LongWaves(operator, sweeps, springs, stiffening) if has_coarser else None
        self._contact_version, self._response = -1, None  # contact version of `_unit_response`, and that

    def apply(self, pc, x, y):
        """Apply the preconditioner to x; store the result in y."""
        with y as out:
            shape = self.operator.local_shape
            self.smooth(x.getArray(readonly=True).reshape(shape), out.reshape(shape))

    def smooth(self, s, z):
        """Compute z = M s with the preconditioner M.

        s is a residual pressure, z an approximate displacement, zero outside the free cells. If `constrained`, the
        `multiplier` is subtracted from s so that z has mean zero.
        """
        self._update_contact()
        with _event:
            self._apply(as_writable(s), z)
        if self.constrained:
            total = sum_over(self.operator.comm, [z.sum(dtype=float)])[0]
            response, total_response = self._unit_response()
            share = total / total_response if total_response > 0 else 0.0
            self.multiplier = share * self.stiffness
            z -= share * response

    def shift(self, amount, *fields):
        """Add one smooth field to each of `fields`.

        The smooth field is zero outside the free cells, and its sum over all cells is `amount`.
        """
        self._update_contact()
        response, total_response = self._unit_response()
        for field in fields if total_response > 0 else ():
            field += amount / total_response * response

    def _update_contact(self):
        """Prepare for a new contact set: halo and springs."""
        if self._contact_version != self.operator.contact_version:
            self._contact_version, self._response = self.operator.contact_version, None
            mask, grid = self.operator.mask, self.operator.grid
            self._free = before, _ = self._rows(mask)
            last = before[-1] if len(before) else np.zeros(grid.nx, bool)
            counts = *loops.count_faces(mask, last, True), np.count_nonzero(mask)
            in_x, in_y, cells = sum_over(self.operator.comm, counts)
            perimeter = max(in_x * grid.dy + in_y * grid.dx, min(grid.dx, grid.dy))
            if self._long_waves and cells:
                self._long_waves.set_contact(mask, cells / grid.n, grid.area / perimeter)

    def _unit_response(self):
        """Return the displacement by a constant pressure, and its sum.

        The pressure is B_00, the diagonal entry of B, in all cells. The preconditioner computes the displacement
        approximately, once for each contact set.
        """
        if self._response is None:
            response = np.empty(self.operator.local_shape)
            even = np.full_like(response, self.stiffness)  # of any unit, 1 in single precision
            self._apply(even, response)
            self._response = response, sum_over(self.operator.comm, [response.sum()])[0]
        return self._response

    def _apply(self, s, z):
        free, waves, no_waves = self.operator.mask, self._long_waves, self._no_waves
        inside = s, *self._rows(s), free, *self._free, self.weights
        x = self._zero
        if self._before is not None:
            swept = z if z.dtype == np.float32 else np.empty(z.shape, np.float32)
            stencil.sweep(*inside, self._before, *x, *no_waves, swept, self._work)
            x = swept, *self._rows(swept)
        waves = waves.apply(s, free, self.weights, *x) if waves else no_waves
        stencil.sweep(*inside, self._after, *x, *waves, z, self._work)

    def view(self, pc, viewer):
        """Describe the preconditioner for -ksp_view."""
        if viewer.getType() == PETSc.Viewer.Type.ASCII:
            if self._before is None:
                sweeps, place = (
                    f"{1 + self._applied_sweeps} sweeps with the centre of B",
                    "added to the first",
                )
            else:
                sweeps, place = f"twice {self._applied_sweeps} sweeps with the centre of B", "between them"
            coarse = self._long_waves.coarse.grid if self._long_waves else None
            more = f", A on {coarse.nx} x {coarse.ny} cells {place}" if coarse else ""
            viewer.printfASCII(f"  {sweeps}{more}\n")


def _weights(kernel, centre, grid):
    """Return 1 / B_00, and the weights of neighbours.

    B_00 is the diagonal entry of B. The weights are entries of the 3 x 3 `centre` of B, divided by B_00, for the
    neighbours in x, in y and on the diagonal. If B is cut to these 3 x 3 entries, long waves have wrong eigenvalues:
    for a stiff coating the neighbours outweigh the diagonal, and sweeps diverge; for a soft one they weigh too little,
    and sweeps undo the work of the coarser grid. So with layers the weights are multiplied by a factor that makes the
    eigenvalue of a long wave right relative to the eigenvalue of a half-space.
    """
    middle, *around = _centre_weights(centre, grid)
    relative = [_relative_eigenvalue(kernel, middle, grid, cells) for cells in LONG_WAVE_CELLS]
    if relative[0] != relative[1] and min(grid.shape) > 2:
        here, there = (-2 * (x + y + 2 * xy) for x, y, xy in (around, _half_space_weights(grid)[1:]))
        waves = zip(LONG_WAVE_CELLS, relative, strict=True)
        wanted = 1 - (1 - there) * max(HALF_SPACE_WAVE_CELLS / cells * value for cells, value in waves)
        if here > 0:
            factor = np.clip(wanted / here, *WEIGHT_FACTORS)
            around = [factor * value for value in around]
    return 1.0 / middle, *map(np.float32, around)


def _centre_weights(centre, grid):
    """Return B_00, the diagonal of B, and the weights of neighbours.

    Along an axis with two cells, both neighbours are the same cell, so that each counts half.
    """
    in_y, in_x = (min(n - 1, 2) / 2 for n in (grid.ny, grid.nx))
    middle = float(centre[1, 1]) or 1.0  # B of a single cell is zero
    around = centre[1, 0] * in_x, centre[0, 1] * in_y, centre[0, 0] * in_x * in_y
    return middle, *(value / middle for value in around)


def _relative_eigenvalue(kernel, diagonal, grid, cells):
    """Return an eigenvalue of B over the half-space's eigenvalue.

    The wave is `cells` long. Both eigenvalues are first divided by the diagonal entry of their B, here `diagonal`.
    """
    q = 2 * np.pi / (cells * np.sqrt(grid.dx * grid.dy))
    return kernel.relative_stiffness(q, _half_space_weights(grid)[0] / diagonal)


def _stiffening(kernel, grid):
    """Return the factor on the stiffness of contact springs, at least 1; 1 for half-spaces.

    On a stiff coating the factor is above 1: long waves bend the coating, and contact holds them more firmly.
    """
    cell = np.sqrt(grid.dx * grid.dy)
    short, long = (kernel.compliance_at(cells * cell) for cells in STIFFENING_WAVE_CELLS)
    return min(max(1.0, long / short) ** STIFFENING_POWER, MAX_STIFFENING)


def _half_space_weights(grid):
    """Return `_centre_weights` of a half-space with compliance 1, from few cells."""
    counts = (min(n, SAMPLE_CELLS) for n in (grid.nx, grid.ny))
    return _weights_of_sample(Grid(*counts, grid.dx, grid.dy, periodic=grid.periodic))


@lru_cache(maxsize=16)
def _weights_of_sample(grid):
    x, y = np.arange(grid.nx), np.arange(grid.ny)
    values = UNIT.eigenvalues(grid, np.minimum(x, grid.nx - x), np.minimum(y, grid.ny - y))
    values[0, 0] = np.inf
    inverse = np.fft.ifft2(1 / values).real.T
    around = np.arange(-1, 2)  # modulo the number of cells, which may be 1
    return _centre_weights(inverse[np.ix_(around % grid.ny, around % grid.nx)], grid)


class _LongWaves:
    """Product with A on a coarser grid, for long waves. Collective.

    If the fine rows of a coarse row are on several ranks, the rank of the first fine row computes the means. The other
    ranks send their parts. `springs` are the compliance of constants and the stiffness of contact, for a half-space. If
    `stiffening`, a factor on the stiffness, is above 1, the share of contact is smoothed twice, and the compliance is
    that of a wave of CONSTANT_WAVE_CELLS.
    """

    def __init__(self, fine, width, springs, stiffening):
        self.coarse, (self._compliance, stiffness) = fine.coarser, springs
        self._stiffness, self._stiffened = stiffening * stiffness, stiffening > 1
        self._wave = CONSTANT_WAVE_CELLS * np.sqrt(fine.grid.dx * fine.grid.dy)
        coarse = self.coarse
        ratios = (-(-n // m) for n, m in zip(fine.grid.shape, coarse.grid.shape, strict=True))
        self._factors = fy, _ = tuple(1 << (ratio - 1).bit_length() for ratio in ratios)  # powers of two
        coarse_slabs, comm = fine.slabs.coarsen(fy), fine.comm
        ranks, rank = (1, 0) if comm is None else (comm.size, comm.rank)
        first, last = fine.slabs.bounds(ranks)
        some, self._skipped = last > first, int(first[rank] % fy)
        low, high = first // fy, np.where(some, -(-last // fy), first // fy)
        self._sums = np.empty((high[rank] - low[rank], coarse.grid.nx))
        self._to_coarse = Fetch(coarse_slabs, [coarse.slabs.bounds(ranks)], comm)
        (ay, by), in_x = fine.grid.places_in(coarse.grid)
        above = np.floor(ay * (first - width) + by - ROW_TOLERANCE).astype(int)
        below = np.floor(ay * (last - 1 + width) + by + ROW_TOLERANCE).astype(int) + 2
        self._around = Fetch(coarse.slabs, [(above, np.where(some, below, above))], comm)
        self._places = (ay, ay * (first[rank] - width) + by - above[rank]), in_x
        # Number of ranks that begin inside each coarse row; they follow the one that makes it.
        inside = np.bincount(low[some & (first % fy > 0)], minlength=coarse.grid.ny)
        begin, end = coarse_slabs.bounds(ranks)
        number = np.where(end > begin, inside[end - 1], 0)
        following = np.arange(1, ranks + 1)
        self._rest = Fetch(Slabs(ranks, ranks, rank), [(following, following + number)], comm)
        self._halo = Halo(coarse.slabs, comm, 1)
        self._u, self._reduction = np.empty(coarse.local_shape), np.ones(coarse.local_shape)
        nx, kind = fine.grid.nx, np.float32  # work rows of all loops
        self._row, self._wide = np.empty(nx, kind), np.empty(coarse.grid.nx + 2, kind)
        self._three = np.empty((3, nx + 2), kind)

    def set_contact(self, free, share, spacing):
        """Set the stiffness of springs that stand for contact.

        `free` are the free cells, `share` is their fraction of all cells, and `spacing` is the area of the patch
        divided by the perimeter of contact [mm].
        """
        coarse = self.coarse
        stencil.contact_in_cells(free, self._sums, self._skipped, self._factors, self._row)
        around = self._gather_coarse()
        for _ in range(1 + self._stiffened):
            before, after = self._halo(around)
            around = _smooth(np.concatenate([before, around, after]))
        self._reduction = 1 / np.sqrt(1 + self._stiffness * share * around)
        if coarse.active:
            compliance = coarse.kernel.compliance_at(self._wave if self._stiffened else spacing)
            coarse.screened_product.screen(1 / (self._compliance * compliance * np.sqrt(share) * spacing))

    def apply(self, s, free, weights, x, *halo):
        """Multiply means over coarse cells by A with springs.

        The means are taken of the field s or, if x is not empty, of the residual of x. Return what `stencil.sweep`
        needs: coarse rows around this rank's rows, their places, and work rows.
        """
        place = self._sums, self._skipped, self._factors
        if x.size:
            stencil.residual_in_cells(s, free, weights, x, *halo, *place, self._three, self._row)
        else:
            stencil.free_in_cells(s, free, weights[0], *place, self._row)
        means = self._reduction * self._gather_coarse()
        if self.coarse.active:
            product = self.coarse.screened_product
            product.apply(means, self._u)
            PETSc.Log.logFlops(product.flops)
        self._u *= self._reduction / weights[0]
        return self._around(self._u), self._places, (self._wide, self._row)

    def _gather_coarse(self):
        """Send the means over coarse cells to the ranks of the coarse grid."""
        sums, rest = self._sums[bool(self._skipped) :], self._rest(self._sums[:1])
        if len(rest):
            sums[-1] += rest.sum(axis=0)
        return self._to_coarse(sums)


def _smooth(field):
    """Return binomial means over 3 x 3 cells, without the outer rows."""
    field = (field[:-2] + 2 * field[1:-1] + field[2:]) / 4
    return (np.roll(field, 1, axis=1) + 2 * field + np.roll(field, -1, axis=1)) / 4
