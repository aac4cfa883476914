"""A prescribed load whose centre is prescribed, too: the bodies tilt.

Let phi = (1, x, y), with x and y counted from the centre of the load. The unknown *position* z has the approach at this
centre and two slopes, so that h = shape - z.phi. The pressure must satisfy ``sum(p phi) dx dy = (F, 0, 0)``. The
numbers on the left increase with z as the load with the approach: their derivative is the stiffness matrix K of the
contact set C, ``K = dx dy sum(q phi)``, where q are the three pressures on C with ``A q = phi`` there. So the methods
of `app.contact.prescribed_load` apply with a matrix for the slope:

- Every active set iteration moves the position by K^-1 times what is missing. The gaps that are left in contact, fitted
  by a linear function, count as missing pressure. K is computed on each grid of at most `MAX_DIRECT_CELLS` cells, and
  is the same on all finer grids.
- `meet` makes load and moments exact before the product that verifies the solution: p is multiplied by a linear
  function, which is 1 up to the small rest that is missing.
- On the first grid, and if the iteration fails, `search` solves for bodies that `Springs` press together: the position
  is z + S^-1 times what is missing. With this position the next solve begins. This is the proximal point method for the
  dual function of z, which is concave and has what is missing as gradient. So it converges for any S if there is a
  solution: if the centre lies inside the convex hull of the cells that may be in contact.

Moments are divided by a length, half the larger side of the patch, and slopes are multiplied by it, so that all numbers
are in N and in mm.
"""

import numpy as np

from app.base.errors import InputError, format_distinct, format_exact
from app.contact.balance import CentredLoad, surrounds
from app.contact.history import Outcome
from app.contact.loading import PrescribedApproach
from app.contact.prescribed_load import (
    LOAD_RESIDUAL_FRACTION,
    LOAD_ROUNDING,
    PrescribedLoad,
    stiffness_of_patch,
)
from app.contact.state import Displacement
from app.contact.tilt import Tilt, linear_sums
from app.halfspace.influence import dense_matrix
from app.multigrid.hierarchy import MAX_DIRECT_CELLS

MAX_STEP = 0.5  # largest step of the position, over that from no load to the load
MIN_STIFFNESS_RATIO = 1e-6  # least stiffness in any direction, over that against the approach
FIRST_SPRING_RATIO, MIN_SPRING_RATIO = 1.0, 1e-3  # stiffness of the springs over that of the contact
MIN_TILT_SPRING_RATIO = 1e-2  # least stiffness of springs against a tilt, over that against the approach
MAX_SPRINGS = 100
COARSE_RTOL = 1e-3  # error of load and moments with which the search on a coarse grid ends
MET_RTOL = 1e-9  # largest error of load and moments of a solution, over the load
NOT_BALANCED = "no pressure was found that has the load and its centre"
MAX_MISSING_AT_START = (
    0.01  # largest missing load or moment of a start, over the load; more is faster without it
)
MAX_MEETS = 20  # corrections of a pressure to meet load and moments


class Springs(PrescribedApproach):
    """Approach and tilt that depend on the pressure: springs carry what is missing. Collective.

    Parameters
    ----------
    loading : TiltedLoad
    state : ContactState
        Without missing load the springs hold it in its present position.
    stiffness : ndarray, shape (3, 3), [N/mm]
        Stiffness of the springs, symmetric positive definite.
    """

    def __init__(self, loading, state, stiffness):
        super().__init__(state.approach, state.depth)
        self._loading, self._state, self._rest = loading, state, loading.position(state)
        self._compliance, self.support = np.linalg.inv(stiffness), self

    def follow(self, p):
        """Move the bodies to the position under a pressure p. Collective."""
        missing = self._loading.wanted - self._loading.carried(self._state, p)
        self._loading.move_to(self._state, self._rest + self._compliance @ missing)

    def add_displacement(self, p, u):
        """Add to u how far the springs give way to a pressure p. Collective."""
        at, x, y = self._compliance @ self._loading.carried(self._state, p)
        in_x, in_y = self._loading.coordinates(self._state.grid, self._state.operator.slabs.rows)
        u += at + x * in_x + (y * in_y)[:, None]


class TiltedLoad(PrescribedLoad):
    """Prescribed total force with a prescribed centre.

    Parameters
    ----------
    load, mean_pressure : float
        See `PrescribedLoad`.
    centre : (float, float)
        Centre of the load [mm].
    length : float
        Length that makes moments forces [mm].
    """

    tilts = True

    def __init__(self, load, mean_pressure, centre, length):
        super().__init__(load, mean_pressure)
        self.tilt, self._length = Tilt(0.0, 0.0, *centre), length
        self.wanted, self.slope = np.array([self.load, 0.0, 0.0]), None  # the slope is the stiffness matrix

    @classmethod
    def about(cls, loading, centre, distance, comm):
        """Return a load with its centre, from a `PrescribedLoad`. Collective over `comm`.

        Raises InputError unless there are cells on all sides of the centre in which contact is possible, and pressures
        up to the hardness can carry the load there.
        """
        grid, text = distance.patch, f"load centre {', '.join(map(format_exact, centre))} mm"
        if not surrounds(distance, centre, comm):
            where = "inside the convex hull of the cells in which contact is possible, not all on one line"
            raise InputError(f"{text}: must be {where}")
        if distance.bounds.capped:
            largest = CentredLoad(distance, loading.load, centre, comm).largest()
            if largest < (1 - LOAD_ROUNDING) * loading.load:
                given, most = format_exact(loading.load), format_distinct(largest, loading.load)
                carried = f"{most} N, which pressures up to the hardness can carry there"
                raise InputError(f"{text}: the load of {given} N must be less than {carried}")
        return cls(loading.load, loading.mean_pressure_on(grid), centre, max(grid.sides) / 2)

    # -- position --------------------------------------------------------------------------------------

    def position(self, state):
        """Return the position of a state [mm]."""
        tilt = state.distance.tilt
        return np.array([state.depth, self._length * tilt.x, self._length * tilt.y])

    def move_to(self, state, position):
        """Move a state to a position [mm]."""
        depth, *slopes = position.tolist()
        state.distance.tilt_to(Tilt(*(slope / self._length for slope in slopes), *self.tilt[2:]))
        state.depth = depth

    def coordinates(self, grid, rows):
        """Return x and y of columns and rows from the centre of the load, over the length."""
        x, y = grid.x(), grid.y(rows)
        return (x - self.tilt.pivot_x) / self._length, (y - self.tilt.pivot_y) / self._length

    def carried(self, state, p):
        """Return load, and moments over the length, of a pressure [N]. Collective."""
        return state.grid.cell_area * self._sums(state, p)[0, 0]

    def _sums(self, state, *fields):
        """Return the `linear_sums` of fields over all cells, shape (fields, 3, 3). Collective."""
        where = self.coordinates(state.grid, state.operator.slabs.rows)
        sums = state.sum(np.ravel([linear_sums(field, *where) for field in fields]))
        return np.reshape(sums, (-1, 3, 3))

    def _balance(self, state):
        """Return what describes the balance of a state, given u = A p. Collective.

        Return the load and moments that it carries [N], the linear function that fits the gaps of C and of overlapping
        cells, as a position [mm], the rms of these gaps [mm], and the mean of phi_i phi_j over these cells.
        """
        gap = state.gap()
        inside = state.contact | (state.not_plastic() & (gap <= 0))
        np.copyto(gap, 0.0, where=~inside)
        counts, gaps, squares, loads = self._sums(state, inside.astype(float), gap, gap * gap, state.p)
        cells = max(counts[0, 0], 1.0)
        fit = np.linalg.pinv(counts, hermitian=True, rcond=1e-12) @ gaps[0]
        return state.grid.cell_area * loads[0], fit, np.sqrt(squares[0, 0] / cells), counts / cells

    def moment_error(self, state):
        """Return the largest error of load and moments, over the load; see `Loading.moment_error`."""
        return float(np.abs(self.carried(state, state.p) - self.wanted).max()) / self.load

    # -- iteration -------------------------------------------------------------------------------------

    def resume(self, state, load):
        """Fit the position to the displacement on C, and move it by the stiffness; see `Loading.resume`.

        The stiffness stays unknown if too much load or moment is missing, or no cell is elastic.
        """
        missing = self.wanted - self.carried(state, state.p)
        if np.abs(missing).max() <= MAX_MISSING_AT_START * self.load:
            self._measure_stiffness(state)
        if self.slope is not None:
            self.move_to(state, np.zeros(3))
            _, position, *_ = self._balance(state)
            self.move_to(state, position + np.linalg.solve(self.slope, missing))

    def begin(self, state):
        """Forget the last step, ensure contact, and store the position; see `Loading.begin`."""
        super().begin(state)
        self._first_position = self.position(state)

    def update(self, state):
        """Move the position by what is missing over the stiffness; see `Loading.update`."""
        if not state.cells_in_contact():
            state.first_contact()
        carried, fit, rms, spread = self._balance(state)
        expected = carried - self.slope @ fit
        step = np.linalg.solve(self.slope, self.wanted - expected)
        largest = MAX_STEP * self.load / np.sqrt(self.slope[0, 0] * (step @ self.slope @ step))
        step *= min(largest, 1.0)
        size = np.sqrt(max(step @ spread @ step, 0.0))
        if size <= LOAD_RESIDUAL_FRACTION * rms:
            return 0.0
        self.move_to(state, self.position(state) + step)
        return size

    def meet(self, state):
        """Multiply p by a linear function, to meet load and moments; u is not updated. Collective."""
        where, area = self.coordinates(state.grid, state.operator.slabs.rows), state.grid.cell_area
        for _ in range(MAX_MEETS):
            p, upper = state.p, state.bounds.upper
            weight = np.where(state.contact, p if upper is None else np.minimum(p, upper - p), 0.0)
            loads, matrix = self._sums(state, p, weight)
            missing = self.wanted / area - loads[0]
            if np.abs(missing).max() <= LOAD_ROUNDING * self.load / area or not matrix[0, 0] > 0:
                return
            factor = np.linalg.pinv(matrix, hermitian=True, rcond=1e-12) @ missing
            linear = factor[0] + factor[1] * where[0] + (factor[2] * where[1])[:, None]
            np.add(p, np.clip(linear, -0.5, 1.0) * weight, out=state.values)
            state.displacement_status = Displacement.STALE

    def settle(self, state, update):
        """Meet load and moments, then fit the gaps in contact; see `Loading.settle`."""
        if not update.cells and not state.plastic_cells():
            return update._replace(added=1)  # continue: there must be contact
        carried, fit, *_ = self._balance(state)
        if not carried[0] > 0:
            state.distribute_load(self.load)
        if np.abs(carried - self.wanted).max() > LOAD_ROUNDING * self.load:
            self.meet(state)
            state.compute_displacement(exact=True)
            carried, fit, *_ = self._balance(state)
            if np.abs(carried - self.wanted).max() > MET_RTOL * self.load:
                self.update(state)  # too few cells of C are away from their bounds
                return update._replace(added=1)
        self.move_to(state, self.position(state) + fit)
        return state.activate_penetrating().after(update)

    def _fill_plateaus(self, state):
        """Leave the load as the search found it."""

    def next_solve(self, state, solve):
        """Solve, and learn the stiffness on small grids; see `Loading.next_solve`."""
        outcome = solve(self)
        if state.grid.n <= MAX_DIRECT_CELLS:
            self._measure_stiffness(state)
        return outcome

    # -- safeguard -------------------------------------------------------------------------------------

    def solve_by_search(self, state, solve, stop, tighter, rtol, step=None):
        """Find the position; see `Loading.solve_by_search`."""
        rtol = rtol if stop.final else max(rtol, COARSE_RTOL)
        outcome = super().solve_by_search(state, solve, stop, tighter, rtol, step)
        missed = stop.final and self.moment_error(state) > MET_RTOL
        return outcome._replace(converged=False, reason=NOT_BALANCED) if missed else outcome

    def search(self, state, solve, rtol, step=None):
        """Find the position by springs that get softer; see `SearchedLoading.search`. Collective."""
        outcome, share = Outcome(True, ""), FIRST_SPRING_RATIO
        if self.slope is None:
            self.slope = stiffness_of_patch(state) * np.diag([1.0, 0.25, 0.25])
        else:
            self.move_to(state, self._first_position)
            state.start_from_interpenetration()
        springs = self.slope + MIN_TILT_SPRING_RATIO * self.slope[0, 0] * np.eye(3)
        for _ in range(MAX_SPRINGS):
            start = state.p.copy(), self.position(state)
            outcome = solve(Springs(self, state, share * springs)).after(outcome)
            if not (outcome.converged or outcome.to_rounding):  # begin again with stiffer springs
                state.values[...], position = start
                self.move_to(state, position)
                share *= 16
                continue
            missing = self.wanted - self.carried(state, state.p)
            energy = missing @ np.linalg.solve(self.slope, missing)
            enough = (rtol * self.load) ** 2 / self.slope[0, 0]
            if energy <= enough:
                break
            share = max(share / 4, MIN_SPRING_RATIO)
        self._measure_stiffness(state)
        return outcome

    def _measure_stiffness(self, state):
        """Compute the stiffness matrix of C, on a small grid. Collective; all ranks do the same work.

        If the grid of the state is too large, it is a coarser one, whose cells are in contact if one of theirs is. If
        the surface compliance varies, the stiffness then stays unknown.
        """
        grid, operator, height, width = state.grid, state.operator, 1, 1
        while grid.n > MAX_DIRECT_CELLS:
            (in_y, in_x), grid = grid.coarsening(), grid.coarsen()
            height, width = height * in_y, width * in_x
        contact, (rows, columns) = np.zeros(grid.shape), np.nonzero(state.contact)
        contact[(rows + operator.slabs.rows.start) // height, columns // width] = 1.0
        cells = np.flatnonzero(state.sum(contact))
        if not cells.size or (grid is not state.grid and operator.compliance is not None):
            return
        x, y = self.coordinates(grid, slice(None))
        phi = np.stack([field.ravel()[cells] for field in np.broadcast_arrays(1.0, x, y[:, None])], axis=1)
        matrix = operator.matrix() if grid is state.grid else dense_matrix(grid, operator.kernel)
        matrix = matrix[np.ix_(cells, cells)]
        stiffness = grid.cell_area * phi.T @ np.linalg.solve(matrix, phi)
        self.slope = stiffness + MIN_STIFFNESS_RATIO * stiffness[0, 0] * np.eye(3)
