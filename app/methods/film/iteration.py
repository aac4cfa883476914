"""The active set iteration on one grid, with a prescribed load as constraint."""

from math import sqrt

from app.contact.active_set import NO_CONTACT, ActiveSetIteration
from app.contact.stopping import BELOW_ROUNDING, ROUNDING_RESIDUAL
from app.methods.film.cg import ConstrainedCG
from app.methods.progress import STAGNATES, TOO_MANY, HalvingTest
from app.methods.safeguard import solve_safeguarded
from app.methods.stopping import UNPROVED

MAX_CHANGED_FRACTION = 0.005  # largest fraction of C that changes on the last contact set of a coarse grid
MAX_LOAD_RATIO = 2.0  # largest factor by which p is scaled to the load; otherwise CG adds the missing load


def interpolate_pressure(transfer, coarse, state):
    """Set pressure and contact set from the coarser grid; the pressure is interpolated. Collective."""
    p, bounds = state.values, state.bounds
    transfer.interpolate(coarse.p, p)
    state.contact[...] = state.admissible
    bounds.project(p, state.contact, p)
    state.contact[...] = state.admissible & bounds.between(p)
    return True


def solve_film(hierarchy, number, state, solver, loading, stop, history, first=False):
    """Solve on one grid; if this fails, by the safeguard. Collective.

    Parameters and result are as in `active_set`; `number` is the number of the level in the hierarchy. If `first` is
    true, this is the first grid. A prescribed load then starts from contact of all cells below the mean height.
    """

    def solve(loading):
        return ConstrainedIteration(state, solver, loading, stop).run(history)

    if loading.load is None:
        outcome = (loading.first_solve if first else loading.next_solve)(state, solve)
    else:
        if first:
            state.depth = state.distance.statistics.mean
            state.start_from_interpenetration()
        outcome = solve(loading)
    if outcome.converged or outcome.to_rounding or outcome.reason == NO_CONTACT:
        return outcome
    return solve_safeguarded(hierarchy, number, state, loading, stop, history).after(outcome)


class ConstrainedIteration(ActiveSetIteration):
    """Iteration on one grid, with a prescribed load as constraint of the linear solver. Collective.

    With a KSP other than ConstrainedCG, the loading changes the approach. The parameters are as in `active_set`.
    """

    too_many = TOO_MANY

    def __init__(self, *args):
        super().__init__(*args)
        self._progress, self._fewest = HalvingTest(), float("inf")
        self._constrained = self._unproved = False

    def solve(self):
        """Solve for the contact set and, under a load, for the approach; see `ActiveSetIteration.solve`."""
        state, solver, by_load = self.state, self.solver, self.loading.load is not None
        self._constrained = by_load and bool(_constrained_cg(solver)) and state.cells_in_contact() > 0
        if not self._constrained:  # with the constraint A is regular in full contact, too
            state.leave_full_contact()
        solver.set_contact()  # makes a new KSP after an interrupt
        if cg := _constrained_cg(solver):
            cg.total = _missing_sum(state, self.loading) if self._constrained else None
        result = solver.solve(state.defect(), self.stop.allowed(state))
        if self._constrained:
            state.depth -= cg.shift
        return result

    def move(self):
        """Change the approach under a prescribed load, unless the solver did."""
        if not self._constrained:
            super().move()

    def passes(self, update):
        """Return whether an update passes the test; on coarse grids a few cells may change."""
        few = 0 if self.stop.final else MAX_CHANGED_FRACTION * update.cells
        return update.changed <= few and update.residual <= self.stop.allowed(self.state, update.h_on_contact)

    def accepts(self):
        """Return whether the certificate is satisfied; if not, make the test stricter."""
        if self.stop.certified(self.state):
            return True
        self.stop, self._progress = self.stop.tighter(0.1), HalvingTest()
        self._unproved = self.stop.at_rounding
        return False

    def gives_up(self, update, history):
        """Return why the iteration ends; see `ActiveSetIteration.gives_up`.

        It ends if neither the residual nor the number of changed cells falls.
        """
        state = self.state
        self._progress.update(update.residual, otherwise=update.changed < self._fewest)
        self._fewest = min(self._fewest, update.changed)
        if self._unproved:
            return UNPROVED
        if not self._progress.stagnates:
            return ""
        # If the cells in contact are flat, the displacement by the mean pressure replaces h.
        flat = sqrt(update.cells) * state.operator.diagonal * state.load / state.grid.area
        size = max(update.h_on_contact, flat)
        return STAGNATES if update.changed or update.residual > ROUNDING_RESIDUAL * size else BELOW_ROUNDING


def _constrained_cg(solver):
    """Return the context of the solver's KSP if it is a ConstrainedCG, else None."""
    cg = solver.ksp.getPythonContext() if solver.ksp.getType() == "python" else None
    return cg if isinstance(cg, ConstrainedCG) else None


def _missing_sum(state, loading):
    """Scale p to the load if they differ little; return the sum of p that is then missing. Collective."""
    present = state.load
    ratio = loading.load / present if present > 0 else float("inf")
    if 1 / MAX_LOAD_RATIO <= ratio <= MAX_LOAD_RATIO and not state.plastic_cells():
        state.scale(ratio)
        return 0.0
    return (loading.load - present) / state.grid.cell_area
