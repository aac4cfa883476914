"""Prescribed loads: root search, Newton steps in the iteration, the exact end."""

from dataclasses import replace

import numpy as np
import periodic
import pytest
from cases import hertz, punch, self_affine
from mpi4py import MPI
from processes import run
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.active_set import active_set
from app.contact.distance import UndeformedDistance
from app.contact.history import History, Outcome
from app.contact.loading import PrescribedApproach
from app.contact.periodic_state import contact_state
from app.contact.prescribed_load import PrescribedLoad, stiffness_of_patch
from app.contact.stopping import StoppingTest
from app.multigrid.direct import DirectSolver
from app.multigrid.hierarchy import Hierarchy


class Exact:
    """A state on a small grid with a direct solver."""

    def __init__(self, problem):
        hierarchy = Hierarchy(problem.grid, problem.material.kernel, MPI.COMM_SELF)
        self.operator, shape = hierarchy.target, problem.shape_on(problem.grid)
        self.distance = UndeformedDistance(self.operator, shape - np.nanmin(shape), np.nanmin(shape))
        self.state = contact_state(self.operator, self.distance)
        self.solver = DirectSolver(self.operator)
        self.approaches = []

    def solve(self, loading):
        if isinstance(loading, PrescribedApproach):
            self.approaches.append(loading.approach)
            self.state.start_from_interpenetration()
        return active_set(self.state, self.solver, loading, StoppingTest(1e-12), History())

    def load_at(self, approach):
        self.state.approach = approach
        assert self.solve(PrescribedApproach(approach)).converged
        return self.state.load

    def destroy(self):
        for part in (self.solver, self.state, self.distance):
            part.destroy()


@pytest.fixture(params=["hertz", "rough", "self-affine"])
def exact(request):
    one = Exact(
        {"hertz": hertz(16), "rough": punch(20), "self-affine": self_affine(16, rolloff=0.5)}[request.param]
    )
    yield one
    one.destroy()


def test_search_raises_the_errors_of_its_solves(exact):
    def solve(loading):
        raise ZeroDivisionError("a listener's")

    with pytest.raises(ZeroDivisionError, match="listener"):
        PrescribedLoad(1.0).search(exact.state, solve, rtol=1e-3)


@pytest.mark.parametrize("share", [1e-3, 0.3, 1.0, 30.0])
@pytest.mark.parametrize("step", [None, 1e-4, 1.0])
def test_search_meets_the_load_from_anywhere(exact, share, step):
    state = exact.state
    middle = exact.load_at(state.distance.reference + 0.5 * spread(state))
    load = share * middle
    loading = PrescribedLoad(load)
    state.depth = 0.1 * spread(state)
    exact.approaches.clear()
    step = step and step * spread(state)
    outcome = loading.search(state, exact.solve, rtol=1e-9, step=step)
    assert outcome.converged
    assert state.load == pytest.approx(load, rel=1e-6)
    assert outcome.iterations >= len(exact.approaches)  # of all solves
    assert len(exact.approaches) <= 40
    # Between the last two approaches tried the load is that of a secant of this slope.
    step = 1e-3 * state.depth
    steeper = exact.load_at(state.approach + step)
    assert loading.slope == pytest.approx((steeper - load) / step, rel=0.3)


@pytest.mark.parametrize("share", [1e-3, 0.03, 0.3, 1.0, 30.0])
def test_load_to_two_percent_takes_at_most_five_solves(exact, share):
    """The overlap of the undeformed bodies gives a good first estimate; doubling would take up to 15."""
    load = share * exact.load_at(exact.state.distance.reference + 0.5 * spread(exact.state))
    exact.approaches.clear()
    assert PrescribedLoad(load).search(exact.state, exact.solve, rtol=0.02).converged
    assert exact.state.load == pytest.approx(load, rel=0.02)
    assert len(exact.approaches) <= 5


def test_prescribed_load_does_not_import_scipy_optimize():
    """Its import takes as long as a solve on 512 x 512 cells."""
    script = (
        "import sys; from app import *;"
        "ball = ContactProblem(Grid.from_domain(64, 64, (-1, 1, -1, 1)), Material.combined(1e5, 0.3), Sphere(10));"
        "print(solve(ball, load=100).converged, 'scipy.optimize' in sys.modules)"
    )
    done = run("-c", script)
    assert done.stdout.split() == ["True", "False"], done.stderr


def spread(state):
    """Return the range of the undeformed distance."""
    values = state.distance.b[state.admissible]
    return values.max() - values.min()


def test_search_ends_if_the_approach_has_no_digits_for_the_load():
    """The load changes by less than the rounding of the approach."""
    shape = np.full((4, 4), 1e6)
    shape[1, 2] = 1e6 - 1
    exact = Exact(ContactProblem(Grid(4, 4, 1.0, 1.0), Material.combined(80000.0, 0.3), shape))
    exact.state.distance.reference = 0.0
    exact.state.move_to(-1e6)
    for load in (1e-12, 1e-30):
        outcome = PrescribedLoad(load).search(exact.state, exact.solve, rtol=1e-3)
        assert outcome.converged
        assert len(exact.approaches) < 200
    exact.destroy()


def test_search_ends_with_the_first_failed_solve(exact):
    failed = Outcome(False, "not today", 3)
    for fails_at in (1, 2):
        calls = []

        def solve_or_fail(loading, calls=calls, fails_at=fails_at):
            calls.append(loading)
            return failed if len(calls) == fails_at else exact.solve(loading)

        exact.state.depth = 0.0
        outcome = PrescribedLoad(1.0).search(exact.state, solve_or_fail, rtol=1e-6)
        assert (outcome.converged, outcome.reason) == (False, "not today")
        assert len(calls) == fails_at
        assert outcome.iterations >= 3


def test_stiffness_of_patch_bounds_that_of_any_contact(exact):
    """It is the first slope of the search."""
    state = exact.state
    low, high = (exact.load_at(state.distance.reference + far * spread(state)) for far in (50.0, 51.0))
    assert state.contact.sum() == state.admissible.sum()
    assert 0.5 * stiffness_of_patch(state) < (high - low) / spread(state) < 1.2 * stiffness_of_patch(state)


def test_update_moves_the_approach_by_the_missing_load_over_the_slope(exact):
    state = exact.state
    right = state.distance.reference + 0.5 * spread(state)
    load = exact.load_at(right)
    loading = PrescribedLoad(2 * load)
    loading.slope = 10 * load / spread(state)
    loading.begin(state)
    before = state.depth
    moved = loading.update(state)
    assert moved == pytest.approx(0.1 * spread(state), rel=1e-6)
    assert state.depth - before == pytest.approx(moved, rel=1e-9)
    # What the residual may be to blame for does not count.
    met = PrescribedLoad(load)
    met.slope = load / state.u[state.contact].mean()
    state.depth = before
    with state.pressure as p:
        p *= 1.0 + 1e-9
    state.compute_displacement()
    assert met.update(state) == 0.0
    assert state.depth == before


def test_slope_is_at_least_the_mean_slope_since_first_touch(exact):
    """This holds for the load, and for the slope that moves the approach."""
    state = exact.state
    touching, depths = state.first_touch(), np.array([0.2, 0.21, 0.5, 0.51]) * spread(state)
    loads = np.array([exact.load_at(state.distance.reference + depth) for depth in depths])
    slopes = np.diff(loads)[::2] / np.diff(depths)[::2]
    assert (slopes >= 0.999 * loads[::2] / (depths[::2] - touching)).all()
    loading = PrescribedLoad(1.1 * loads[-1])
    loading.begin(state)
    loading.slope = 1e-3 * loads[-1] / spread(state)
    assert loading.update(state) <= 0.1001 * (depths[-1] - touching)


def test_prediction_extrapolates_a_geometric_series():
    loading = PrescribedLoad(1.0)
    found = []
    for depth in (1.0, 2.0, 2.25, 2.3125):
        loading.record(depth)
        found.append(loading.predict(depth))
    assert found[:2] == [1.0, 2.0]
    assert found[2] == pytest.approx(2.25 + 0.25 * 0.25)
    assert found[3] == pytest.approx(2.3125 + 0.25 * 0.0625)
    assert PrescribedApproach(3.0).predict(1.5) == 1.5


def surface_of_few_heights(kind, n):
    """A gap with many lowest cells, which is smoother on coarse grids."""
    if kind == "grooves":
        return 0.1 * np.tile([0.0, 1.0], (n, n // 2))
    if kind == "pins":
        return 0.1 * (np.add.outer(np.arange(n) % 4, np.arange(n) % 4) > 0)
    return np.round(3 * np.random.default_rng(1).random((n, n))) / 3 * 0.1


@pytest.mark.parametrize("load", [1e-7, 1e-5, 1e-3, 0.1])
@pytest.mark.parametrize(("kind", "n"), [("grooves", 32), ("pins", 64), ("quantized", 128)])
def test_light_loads_on_surfaces_of_few_heights(kind, n, load):
    """The first load on the target grid is up to 1e11 times as large; its rounding must not stay in u."""
    gap = surface_of_few_heights(kind, n)
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    found = solve(ContactProblem(grid, Material.from_contact_modulus(1e5), gap), None, None, load)
    assert found.fallbacks == 0 and found.iterations < 25 and found.operator_applications < 100
    assert found.load == pytest.approx(load, rel=1e-6)
    assert found.error_bound < 1e-2
    e, p = found.gap, found.pressure
    assert -e.min() < 1e-3 * found.displacement.max() and (p >= 0).all()
    assert abs(e[p > 0]).max() < 1e-3 * found.displacement.max()


@pytest.mark.parametrize("method", ["fmg_v11", "norm"])
@pytest.mark.parametrize("share", [0.1, 0.7, 0.95])
def test_plastic_contact_of_a_periodic_patch_needs_no_root_search(method, share):
    problem = replace(periodic.rough(32, 32, 1), hardness=0.05)
    solution = solve(problem, None, method, load=share * 0.05 * problem.grid.area)
    assert solution.converged and not solution.fallbacks and solution.iterations <= 20
    assert solution.plastic.any() and solution.load == pytest.approx(
        share * 0.05 * problem.grid.area, rel=1e-12
    )


def test_settled_load_is_exact_with_zero_mean_gap_in_contact(exact):
    state = exact.state
    load = exact.load_at(state.distance.reference + 0.5 * spread(state))
    loading = PrescribedLoad(1.001 * load)
    update = loading.settle(state, state.activate_penetrating())
    assert state.load == pytest.approx(1.001 * load, rel=1e-14)
    assert update.cells == state.contact.sum()
    e = state.gap()[state.contact]
    assert abs(e.mean()) < 1e-3 * 0.001 * spread(state)


@pytest.mark.parametrize("method", ["norm", "fmg_v11"])
def test_few_cells_of_an_odd_periodic_grid_carry_a_load(method):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        gap = 0.1 * rng.random((9, 9))
        gap[rng.random((9, 9)) < 0.9] = np.nan
        problem = ContactProblem(
            Grid.from_domain(9, 9, (0, 1, 0, 1)), Material.from_contact_modulus(1e3), gap, periodic=True
        )
        with ContactSolver(problem, method) as solver:
            found = solver.solve(load=1.0)
        assert found.converged and found.load == pytest.approx(1.0)
