"""Loadings from numbers: consistency of the four kinds, and refusals."""

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, fit_grid, solve, solve_many
from app.contact.loading_input import LOADINGS, make_loading
from app.verification.dense import DenseProblem

GRID = Grid.from_domain(16, 12, (0.0, 4.0, 0.0, 3.0))


STEEL = Material.from_contact_modulus(1000.0)


GAP = 5.0 + 1e-3 * np.random.default_rng(3).normal(size=GRID.shape)


MEAN = GAP.mean()


HOLED = np.where(np.arange(16) == 3, np.nan, GAP)


def make_solver(periodic=True, gap=GAP):
    return ContactSolver(ContactProblem(GRID, STEEL, gap, periodic), "norm")


def make_loading_of(solver, **given):
    return make_loading(solver.problem.grid, solver._distances[-1], **given)


@pytest.fixture(scope="module")
def solvers():
    made = {
        name: make_solver(*of)
        for name, of in {"free": (False,), "periodic": (True,), "holed": (True, HOLED)}.items()
    }
    yield made
    for one in made.values():
        one.close()


@pytest.mark.parametrize("name", ["free", "periodic", "holed"])
def test_mean_pressure_is_load_over_area(solvers, name):
    here = solvers[name]
    by_pressure, by_load = here.solve(mean_pressure=0.02), here.solve(load=0.24)
    assert by_pressure.load == pytest.approx(0.24, rel=1e-12)
    assert by_pressure.mean_pressure == pytest.approx(0.02, rel=1e-12)
    assert_proved_equal(by_pressure, by_load)


@pytest.mark.parametrize("name", ["free", "periodic", "holed"])
@pytest.mark.parametrize("kind", LOADINGS)
def test_prescribed_numbers_are_reported_exactly(solvers, name, kind):
    numbers = (np.array([0.013, 0.13, 1.7, 2.3]) * (1e-3 if LOADINGS[kind].unit == "mm" else 1)).tolist()
    if kind == "approach":
        numbers = [GAP.min() + number for number in numbers[:2]]
    if kind == "mean_gap" and name != "periodic":
        return
    path = solvers[name].path(**{kind: numbers})
    solutions = list(path)
    assert all(solution.converged for solution in solutions)
    assert [getattr(solution, kind) for solution in solutions] == path.table[kind].tolist() == numbers
    for solution in solutions:
        assert solution.mean_pressure == pytest.approx(solution.load / GRID.area, rel=1e-15)


def test_mean_gap_is_met(solvers):
    by_gap = solvers["periodic"].solve(mean_gap=1e-3)
    by_approach = solvers["periodic"].solve(approach=MEAN - 1e-3)
    assert by_gap.mean_gap == pytest.approx(1e-3, abs=1e-14)
    assert by_gap.approach == pytest.approx(by_approach.approach, abs=1e-14)
    assert_proved_equal(by_gap, by_approach)


@pytest.mark.parametrize("constant", [1e3, -1e6])
def test_solution_of_a_mean_gap_is_independent_of_a_constant_height(constant):
    gap = constant + 1e-3 * np.random.default_rng(1).random((16, 16))
    lowest = gap - gap.min()  # without rounding
    touching = lowest.mean()
    # Below the last digits of the constant, too, and as near to the ends.
    for mean_gap in (1e-13, 1e-9, touching / 2, touching - 1e-9, touching - 1e-12):
        found, expected = (
            solve(
                ContactProblem(Grid.from_domain(16, 16, (0, 1, 0, 1)), STEEL, of, periodic=True),
                mean_gap=mean_gap,
                options={"lcp_error_bound": 1e-8},
            )
            for of in (gap, lowest)
        )
        assert found.mean_gap == expected.mean_gap == pytest.approx(mean_gap, rel=1e-6, abs=1e-15)
        assert found.load == pytest.approx(expected.load, rel=1e-9)
        assert found.approach == pytest.approx(gap.min() + expected.approach, rel=1e-15)


CHECKERS = np.indices((34, 13)).sum(axis=0) % 2


def checkers(size=1.0, constant=0.2):
    """A checkerboard: half of the cells touch at once."""
    return ContactProblem(
        Grid.from_domain(13, 34, (0, 13, 0, 34)), STEEL, constant + size * CHECKERS, periodic=True
    )


@pytest.mark.parametrize("method", [None, "norm"])
def test_depth_of_rounding_size_is_first_touch(method):
    gap = checkers().gap
    by_mean = float(gap.mean() - np.spacing(gap.mean()) - gap.min())
    for loading in ({"approach": np.nextafter(0.2, 9)}, {"approach": 0.2 + 1e-16}, {"mean_gap": by_mean}):
        solution = solve(checkers(), method=method, **loading)
        assert solution.converged and solution.load == 0.0
        np.testing.assert_array_equal(solution.undeformed_distance, CHECKERS)


@pytest.mark.parametrize("beyond", [1e-14, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize(("size", "constant"), [(1.0, 0.0), (1.0, 0.2), (1e-9, 0.0), (1e-9, 1e-9)])
def test_light_load_is_proportional_to_the_depth(size, constant, beyond):
    loads = []
    for depth in (beyond, 1e-3):
        approach = constant + depth * size
        solution = solve(checkers(size, constant), approach=approach)
        assert solution.converged and not solution.fallbacks
        np.testing.assert_array_equal(solution.contact, CHECKERS == 0)
        assert not solution.pressure[~solution.contact].any()
        loads.append(solution.load / (approach - constant))
    assert loads[0] == pytest.approx(loads[1], rel=2e-3)


REFUSED = {
    "none": ("free", {}, "exactly one of approach .mm., load .N., mean_pressure .N/mm2. and mean_gap .mm. is needed"),
    "two": ("periodic", {"load": 1, "mean_gap": 0}, "exactly one"),
    "no number": ("free", {"mean_pressure": "much"}, "mean_pressure: is str; must be a number"),
    "tension": ("free", {"mean_pressure": -1}, "mean_pressure -1: must be at least 0 N/mm2"),
    "mean gap of a free patch": ("free", {"mean_gap": 0.1}, "mean_gap: only on a periodic patch"),
    "mean gap with holes": ("holed", {"mean_gap": 0.1}, "mean_gap 0.1: contact is impossible in 12 cells"),
    "negative mean gap": ("periodic", {"mean_gap": -0.1}, "mean_gap -0.1: .* must be at least 0 mm"),
    "mean gap above the undeformed": ("periodic", {"approach": MEAN + 1e-6}, "negative; it must be at most 5.00"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_invalid_loadings_are_refused(solvers, name):
    which, given, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        solvers[which].solve(**given)


@pytest.mark.parametrize(
    "given", [{"mean_gap": 0}, {"mean_gap": -1e-19}, {"approach": MEAN}, {"approach": np.nextafter(MEAN, 9)}]
)
def test_loadings_up_to_full_contact_are_allowed(solvers, given):
    loading = make_loading_of(solvers["periodic"], **given)
    assert loading.approach == pytest.approx(MEAN, abs=1e-14)


@pytest.mark.parametrize("periodic", ["spectral", "love"])
@pytest.mark.parametrize(
    "material", [STEEL, Material.coated((5.0, 1.0), (0.3, 0.3), 0.2), Material.layer(1.0, 0.3, 0.2)]
)
def test_every_mean_gap_has_a_solution_with_a_hardness(material, periodic):
    """Between, at and beyond full plasticity, as on the dense matrix; at the elastic limit the sign decides."""
    rng = np.random.default_rng(3)
    gap, elastic = 0.01 * rng.random((7, 6)), rng.random((7, 6)) < 0.2
    body = ContactProblem(Grid(6, 7, 0.1, 0.1, periodic=periodic), material, gap)
    hardness = 0.6 * solve(body, mean_gap=0.0).max_pressure * (1 + rng.random((7, 6)))
    for limit in (hardness, np.where(elastic, np.inf, hardness)):
        problem = replace(body, hardness=limit)
        dense = DenseProblem(problem)
        overlap = (gap.ravel() + dense.matrix @ hardness.ravel()).max() - gap.mean()  # of full plasticity
        for mean_gap in (1e-3, 0.0, -1e-5, -0.5 * overlap, -overlap, -1.001 * overlap, -3 * overlap, -10.0):
            found, exact = solve(problem, mean_gap=mean_gap), dense.with_mean_gap(mean_gap).astype(float)
            assert found.converged
            assert found.mean_gap - found.mean_plastic_depth == pytest.approx(mean_gap, abs=1e-7, rel=1e-12)
            assert found.mean_gap >= 0
            np.testing.assert_allclose(found.pressure, exact, atol=1e-5 * exact.max())
            error, size = (dense.energy(p) for p in (found.pressure - exact, found.pressure))
            assert error <= found.error_bound * size + 1e-12 * exact.max()


def test_bound_holds_where_all_cells_touch_beyond_full_contact():
    """No gap without overlaps has a negative mean."""
    gap = 0.01 * np.random.default_rng(5).random((2, 2))
    body = ContactProblem(Grid(2, 2, 0.1, 0.1, periodic="love"), STEEL, gap)
    problem = replace(body, hardness=1.3 * solve(body, mean_gap=0.0).max_pressure)
    dense = DenseProblem(problem)
    for loading in ({"mean_gap": -1e-12}, {"approach": gap.mean() + 1e-12}):
        found = solve(problem, **loading)
        error = dense.energy(found.pressure - dense.with_mean_gap(-1e-12))
        assert error <= found.error_bound * dense.energy(found.pressure)


@pytest.mark.parametrize("share", [1e-3, 1e-8, 1e-12])
def test_mean_gap_near_first_touch_keeps_its_digits(share):
    """The depth is the exact mean undeformed distance minus the mean gap."""
    gap = np.random.default_rng(1).random((30, 41))
    gap[7, 8] = 0.0
    problem = ContactProblem(Grid(41, 30, 0.1, 0.1), Material.from_contact_modulus(1e5), gap, periodic=True)
    wanted = (1 - share) * gap.mean()
    depth = sum(map(Fraction, gap.ravel().tolist())) / gap.size - Fraction(wanted)
    with ContactSolver(problem) as solver:
        found = solver.solve(mean_gap=wanted)
    assert found.indentation == pytest.approx(float(depth), rel=1e-15, abs=0)


class _DataArray:
    """An array without dimensions of another library, as xarray's."""

    shape = ()

    def __init__(self, value):
        self.value = value

    def item(self):
        return self.value

    def __len__(self):
        raise TypeError("len() of unsized object")


@pytest.mark.parametrize("scalar", [Decimal, Fraction, np.array, np.float32, np.ma.array, _DataArray])
def test_scalars_of_any_library_are_numbers(scalar):
    problem = ContactProblem(GRID, STEEL, GAP)
    expected = solve(problem, load=4.0, options={"lcp_rtol": 0.5**20}).approach
    assert solve(problem, load=scalar(4.0), options={"lcp_rtol": scalar(0.5**20)}).approach == expected
    assert list(solve_many([problem], scalar(4.0))["load"]) == [4]
    with ContactSolver(problem) as solver:
        assert [step.load for step in solver.path(load=[scalar(2.0), scalar(4.0)])] == [2, 4]
    assert fit_grid(Sphere(8), STEEL, load=scalar(4.0)) == fit_grid(Sphere(8), STEEL, load=4.0)
    with pytest.raises(InputError, match="load"):
        solve(problem, load=np.ma.masked)
