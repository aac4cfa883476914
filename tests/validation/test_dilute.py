"""Dilute contact on lists of cells: the same answers, with right bounds."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Listener, Material
from app.contact import loading_input
from app.contact.approach_search import SearchedLoading
from app.halfspace import list_product
from app.halfspace.operator import InfluenceOperator
from app.methods.free import dilute
from app.verification.dense import DenseProblem

MATERIAL = Material.from_contact_modulus(1.0)
GRID = Grid(28, 24, 1.0, 1.2)


def far_cells(rng):
    gap = 1e3 * (1 + rng.random(GRID.shape))
    gap.flat[rng.choice(GRID.n, 9, replace=False)] = 0.1 * rng.random(9)
    return gap


def spikes(rng):
    gap = 5 + rng.random(GRID.shape)
    gap.flat[rng.choice(GRID.n, 40, replace=False)] -= 4 * rng.random(40)
    return gap


def plateaus(rng):
    gap = np.full(GRID.shape, 3.0)
    for _ in range(6):
        j, i = rng.integers(0, 20), rng.integers(0, 24)
        gap[j : j + 4, i : i + 4] = rng.integers(0, 3)
    return gap


def walls(rng):
    y, x = np.ogrid[:24, :28]
    gap = 0.02 * ((x - 28 * rng.random()) ** 2 + (y - 24 * rng.random()) ** 2)
    gap[:, rng.integers(0, 28)] += 1e2
    gap[rng.integers(0, 24)] += 1e6
    return gap


def balls(rng):
    y, x = np.ogrid[:24, :28]
    centres = rng.random((5, 3)) * (28, 24, 0.5)
    return np.min([0.05 * ((x - i) ** 2 + (y - j) ** 2) + h for i, j, h in centres], axis=0)


KINDS = far_cells, spikes, plateaus, walls, balls


def layer(rng, gap, load):
    thickness = rng.choice([0.7, 3.0, 12.0])
    return ContactProblem(GRID, Material.layer(1.0, 0.45, thickness), gap)  # coefficients change sign


def coating(rng, gap, load):
    stiffness = rng.choice([0.02, 60.0])
    return ContactProblem(GRID, Material.coated((stiffness, 1.0), (0.3, 0.3), 2.0), gap)


def hardness(rng, gap, load):
    return ContactProblem(GRID, MATERIAL, gap, hardness=load / GRID.cell_area / rng.uniform(2.0, 20.0))


def uneven_hardness(rng, gap, load):
    upper = load / GRID.cell_area / rng.uniform(2.0, 20.0, GRID.shape)
    return ContactProblem(GRID, MATERIAL, gap, hardness=np.where(rng.random(GRID.shape) < 0.1, np.inf, upper))


def holes(rng, gap, load):
    j, i = np.unravel_index(gap.argmin(), GRID.shape)
    gap[max(j - 1, 0) : j + 2, i] = np.nan  # where the bodies would touch first
    gap[rng.random(GRID.shape) < 0.3] = np.nan
    return ContactProblem(GRID, MATERIAL, gap)


def all_together(rng, gap, load):
    upper = load / GRID.cell_area / rng.uniform(2.0, 20.0)
    gap[rng.random(GRID.shape) < 0.2] = np.nan
    return ContactProblem(GRID, Material.layer(1.0, 0.45, 3.0), gap, hardness=upper)


OTHERS = layer, coating, hardness, uneven_hardness, holes, all_together


@pytest.fixture
def forced(monkeypatch):
    """Solve grids of any size on lists, and count the solves that did so."""
    monkeypatch.setattr(dilute, "MIN_CELLS", 64)
    for name in ("MAX_COST", "MAX_GROWN_COST", "MAX_CHECK_COST", "MAX_SHARE"):
        monkeypatch.setattr(dilute, name, np.inf)
    done = []

    def count(name):
        solve = getattr(dilute.DiluteContact, name)

        def counted(*args):
            result = solve(*args)
            done.append(result is not None)
            return result

        monkeypatch.setattr(dilute.DiluteContact, name, counted)

    count("solve")
    count("resume")
    return done


def assert_within_bound(found, p, dense, rounding=1e-14):
    """Assert a solution without the safeguard, and an error within its bound and the rounding of the approach."""
    assert found.converged and not found.fallbacks
    size = dense.energy(found.pressure)
    assert dense.energy(found.pressure - p) <= (found.error_bound + rounding) * size


def solve(problem, options=None, **loading):
    with ContactSolver(problem, options=options) as solver:
        return solver.solve(**loading)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("split", [True, False], ids=["split", "all pairs"])
def test_lists_give_the_exact_solution_up_to_their_bound(kind, rtol, split, forced, monkeypatch):
    monkeypatch.setattr(list_product, "_LARGEST_TABLE", 0 if split else GRID.n)
    for seed in range(2):
        problem = ContactProblem(GRID, MATERIAL, kind(np.random.default_rng(seed)))
        dense, options = DenseProblem(problem), {"lcp_rtol": rtol}
        for load in (1e-3, 0.3, 10.0):
            by_load = solve(problem, options, load=load)
            by_approach = solve(problem, options, approach=by_load.approach)
            exact = dense.under(load, by_load.approach)[0], dense.at(by_load.approach)
            for found, p in zip((by_load, by_approach), exact, strict=True):
                assert_within_bound(found, p, dense)
            assert by_load.load == pytest.approx(load, rel=1e-12)
    assert len(forced) == 12 and sum(forced) >= 10  # where coarse grids mislead, all cells are used


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", OTHERS)
def test_layers_hardness_and_holes_keep_the_bound(make, kind, forced, monkeypatch):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        load, rtol, split = rng.choice([0.03, 1.0]), rng.choice([1e-4, 1e-6, 1e-9]), rng.choice([0, GRID.n])
        monkeypatch.setattr(list_product, "_LARGEST_TABLE", split)
        problem = make(rng, kind(rng), load)
        dense, options = DenseProblem(problem), {"lcp_rtol": rtol, "lcp_type": "fast"}
        by_load = solve(problem, options, load=load)
        by_approach = solve(problem, options, approach=by_load.approach)
        exact = dense.under(load, by_load.approach)[0], dense.at(by_load.approach)
        for found, p in zip((by_load, by_approach), exact, strict=True):
            assert_within_bound(found, p, dense, 1e-11)  # loads are met to 1e-12 if cells are plastic
            assert not found.pressure[np.isnan(problem.gap)].any()
            assert (found.pressure <= (np.inf if problem.hardness is None else problem.hardness)).all()
    assert len(forced) == 6 and sum(forced) >= 5


@pytest.mark.parametrize("seed", [4, 6, 7])
def test_a_load_that_is_far_exceeded_at_first_is_not_lost_in_rounding(seed, forced):
    rng = np.random.default_rng(seed)
    gap, j, i = np.full(GRID.shape, 1e5), rng.integers(0, 20), rng.integers(0, 25)
    gap[j : j + 2, i : i + 2] = 0.0  # most coarse cells are far higher: the first depth is much too large
    gap[j, i + 1] = 1e-12
    problem = ContactProblem(GRID, MATERIAL, gap)
    found, dense = solve(problem, load=1e-10), DenseProblem(problem)
    exact = dense.under(1e-10, found.approach)[0]
    assert forced == [True] and found.converged
    assert dense.energy(found.pressure - exact) <= found.error_bound * dense.energy(found.pressure)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", [lambda rng, gap, load: ContactProblem(GRID, MATERIAL, gap), *OTHERS])
def test_fields_and_numbers_are_those_without_lists(make, kind, forced, monkeypatch):
    rng = np.random.default_rng(7)
    problem = make(rng, kind(rng), 1.0)
    found = solve(problem, {"lcp_rtol": 1e-10}, load=1.0)
    assert forced == [True]
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    usual = solve(problem, {"lcp_rtol": 1e-10}, load=1.0)
    assert (found.contact == usual.contact).all()
    for name in ("pressure", "displacement", "gap"):
        values = getattr(usual, name)
        np.testing.assert_allclose(
            getattr(found, name), values, rtol=1e-5, atol=1e-5 * np.nanmax(abs(values))
        )
    names = "mean_gap", "max_pressure", "perimeter", "contact_extent_x", "moment_x", "approach", "indentation"
    names += "plastic_area", "plastic_volume", "contact_area", "contact_fraction"
    for name in names:
        assert getattr(found, name) == pytest.approx(getattr(usual, name), rel=1e-6)


@pytest.mark.parametrize("make", [hardness, holes])
@pytest.mark.parametrize("split", [True, False], ids=["split", "all pairs"])
def test_the_displacement_needs_no_product_on_all_cells(make, split, forced, monkeypatch):
    monkeypatch.setattr(list_product, "_LARGEST_TABLE", 0 if split else GRID.n)
    rng = np.random.default_rng(7)
    problem = make(rng, balls(rng), 0.3)
    with ContactSolver(problem) as solver:
        found, target = solver.solve(load=0.3), solver.hierarchy.target
        u = found.displacement
        assert forced == [True] and "exact_product" not in vars(target)
    whole = np.empty(GRID.shape)
    InfluenceOperator(GRID, MATERIAL.kernel).exact_displacement(found.pressure, whole)
    np.testing.assert_allclose(u, whole, rtol=1e-7 if split else 1e-12)
    assert found.displacement is u and found.gather().displacement is u


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ratio", [0.01, 0.8, 1.0, 1.3, 30.0])
def test_a_start_gives_the_exact_solution_up_to_its_bound(kind, ratio, forced):
    problem, load = ContactProblem(GRID, MATERIAL, kind(np.random.default_rng(1))), 0.3
    with ContactSolver(problem) as solver:
        first = solver.solve(load=load)
        again = solver.solve(load=ratio * load, start=first)
        back = solver.solve(approach=first.approach, start=again)
        assert forced[0] is False or "exact_product" not in vars(solver.hierarchy.target)
    dense = DenseProblem(problem)
    exact = dense.under(ratio * load, again.approach)[0], dense.at(first.approach)
    for found, p in zip((again, back), exact, strict=True):
        assert_within_bound(found, p, dense)
    assert len(forced) == 3 and (all(forced) or not forced[0])


@pytest.mark.parametrize("make", OTHERS)
@pytest.mark.parametrize("ratio", [0.3, 1.2])
def test_other_bodies_start_on_lists(make, ratio, forced, monkeypatch):
    rng = np.random.default_rng(3)
    problem = make(rng, balls(rng), 0.3)
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        first = solver.solve(load=0.3)
        again = solver.solve(load=ratio * 0.3, start=first)
    assert forced == [True, True]
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    usual = solve(problem, {"lcp_rtol": 1e-9}, load=ratio * 0.3)
    assert (again.contact == usual.contact).all()
    np.testing.assert_allclose(again.pressure, usual.pressure, atol=1e-5 * usual.max_pressure)
    np.testing.assert_allclose(again.displacement, usual.displacement, atol=1e-5 * usual.displacement.max())
    assert again.mean_gap == pytest.approx(usual.mean_gap, rel=1e-5)
    assert again.plastic_volume == pytest.approx(usual.plastic_volume, rel=1e-4, abs=1e-12)


def test_a_near_start_takes_fewer_products(forced):
    problem = ContactProblem(GRID, MATERIAL, balls(np.random.default_rng(7)))
    with ContactSolver(problem) as solver:
        first = solver.solve(load=0.3)
        afresh = solver.solve(load=0.303)
        again = solver.solve(load=0.303, start=first)
    assert forced == [True] * 3
    assert again.operator_applications < afresh.operator_applications
    assert {*again.history["level"]} == {max(afresh.history["level"])}


def test_a_start_without_contact_is_no_reason_to_solve_on_all_cells(forced):
    problem = ContactProblem(GRID, MATERIAL, balls(np.random.default_rng(7)))
    with ContactSolver(problem) as solver:
        nothing, afresh = solver.solve(load=0), solver.solve(load=0.3)
        again = solver.solve(load=0.3, start=nothing)
    np.testing.assert_array_equal(again.pressure, afresh.pressure)
    assert again.operator_applications == afresh.operator_applications


def test_listeners_get_fields_and_numbered_iterations(forced):
    seen, gap = [], np.full(GRID.shape, 5.0)
    y, x = np.ogrid[:24, :28]
    gap = 0.02 * ((x - 14.5) ** 2 + (y - 12.5) ** 2)
    gap[3, 4] = gap[20, 25] = -0.3  # found after the first solve of the target grid

    class Log(Listener):
        def start(self, state, level):
            assert state.contact.shape == state.grid.shape

        def iteration(self, entry, state):
            seen.append((entry["level"], entry["iteration"]))
            if entry["level"] == self.top:
                u = np.empty(GRID.shape)
                InfluenceOperator(GRID, MATERIAL.kernel).exact_displacement(state.p, u)
                np.testing.assert_allclose(state.u, u, rtol=1e-7)
                assert np.count_nonzero(state.contact) == entry["contact_cells"]
                assert entry["load"] == pytest.approx(GRID.cell_area * state.p.sum())

    log = Log()
    with ContactSolver(ContactProblem(GRID, MATERIAL, gap), listeners=[log]) as solver:
        log.top = len(solver.hierarchy.levels) - 1
        found = solver.solve(load=0.5)
    assert forced == [True] and found.converged
    last = [iteration for level, iteration in seen if level == log.top]
    assert last == list(range(1, found.iterations + 1))


@pytest.mark.parametrize("kind", [spikes, plateaus, walls, balls])
def test_a_searched_number_is_found_on_lists(kind, forced, monkeypatch):
    class PrescribedMaxPressure(SearchedLoading):
        name = kind = "max_pressure"
        unit = "N/mm2"

        @classmethod
        def create(cls, value, grid, distance, uniform_compliance=0.0):
            return cls(value)

        def measure(self, state):
            return -float(state.minimum([-state.p.max(initial=0.0)])[0])

    monkeypatch.setitem(loading_input.LOADINGS, "max_pressure", PrescribedMaxPressure)
    problem = ContactProblem(GRID, MATERIAL, kind(np.random.default_rng(7)))
    found = solve(problem, {"lcp_rtol": 1e-8}, max_pressure=0.1)
    assert found.converged and found.max_pressure == pytest.approx(0.1, rel=2e-5)
    assert forced == [True] or kind is walls
    p = DenseProblem(problem).at(found.approach)
    np.testing.assert_allclose(found.pressure, p, atol=1e-3 * p.max())


@pytest.mark.parametrize("loading", [{"load": 0.3}, {"mean_pressure": 1e-3}, {"approach": 0.8}])
def test_tilted_bodies_are_solved_on_lists(loading, forced, monkeypatch):
    problem = ContactProblem(GRID, MATERIAL, balls(np.random.default_rng(7)))
    with ContactSolver(problem, options={"lcp_rtol": 1e-8}) as solver:
        found = [solver.solve(**loading, tilt=tilt) for tilt in (None, (0.01, -0.02), (-0.01, 0.0), None)]
    assert forced == [True] * 4
    monkeypatch.setattr(dilute, "MIN_CELLS", 10**9)
    with ContactSolver(problem, options={"lcp_rtol": 1e-8}) as solver:
        usual = solver.solve(**loading, tilt=(0.01, -0.02))
    assert (found[1].contact == usual.contact).all() and (found[1].contact != found[2].contact).any()
    np.testing.assert_allclose(found[1].pressure, usual.pressure, atol=1e-4 * usual.max_pressure)
    np.testing.assert_allclose(found[1].gap, usual.gap, atol=1e-4 * usual.gap.max())
    assert found[1].approach == pytest.approx(usual.approach, rel=1e-5)
    assert found[1].mean_gap == pytest.approx(usual.mean_gap, rel=1e-5)
    np.testing.assert_allclose(found[0].pressure, found[3].pressure, rtol=1e-12)


@pytest.mark.parametrize("what", ["compliance", "load_centre"])
def test_other_problems_are_solved_on_all_cells(what, forced):
    gap = balls(np.random.default_rng(7))
    compliance = 0.1 if what == "compliance" else 0.0
    centre = {"load_centre": (13.0, 14.0)} if what == "load_centre" else {}
    problem = ContactProblem(GRID, MATERIAL, gap, surface_compliance=compliance)
    found = solve(problem, load=0.3, **centre)
    assert found.converged and not forced
