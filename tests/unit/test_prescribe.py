"""The four ways to prescribe a loading: how they hang together, what is refused."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material
from app.contact.loading import LOADINGS
from app.errors import InputError

GRID = Grid.from_domain(16, 12, (0.0, 4.0, 0.0, 3.0))
STEEL = Material.from_contact_modulus(1000.0)
GAP = 5.0 + 1e-3 * np.random.default_rng(3).normal(size=GRID.shape)
MEAN = GAP.mean()
HOLED = np.where(np.arange(16) == 3, np.nan, GAP)


def solver(periodic=True, gap=GAP):
    return ContactSolver(ContactProblem(GRID, STEEL, gap, periodic), "norm")


@pytest.fixture(scope="module")
def solvers():
    made = {
        name: solver(*of)
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
    np.testing.assert_allclose(by_pressure.pressure, by_load.pressure, rtol=1e-12)


def test_mean_gap_is_met(solvers):
    by_gap, by_approach = (
        solvers["periodic"].solve(mean_gap=1e-3),
        solvers["periodic"].solve(approach=MEAN - 1e-3),
    )
    assert by_gap.mean_gap == pytest.approx(1e-3, abs=1e-14)
    assert by_gap.approach == pytest.approx(by_approach.approach, abs=1e-14)
    np.testing.assert_allclose(by_gap.pressure, by_approach.pressure, rtol=0, atol=1e-9)


@pytest.mark.parametrize("load", [{"load": 0}, {"mean_pressure": 0}])
def test_no_load_is_first_touch(solvers, load):
    solution = solvers["periodic"].solve(**load)
    assert (solution.load, solution.approach) == (0.0, GAP.min())


REFUSED = {
    "none": (
        "free",
        {},
        "exactly one of approach .mm., load .N., mean_pressure .N/mm2. and mean_gap .mm. is needed",
    ),
    "two": ("periodic", {"load": 1, "mean_gap": 0}, "exactly one"),
    "no number": ("free", {"mean_pressure": "much"}, "mean_pressure: is str; needed: a number"),
    "tension": (
        "free",
        {"mean_pressure": -1},
        "mean_pressure -1: the bodies do not stick .* at least 0 N/mm2",
    ),
    "mean gap of a free patch": ("free", {"mean_gap": 0.1}, "mean_gap 0.1: only on a periodic patch"),
    "mean gap with holes": ("holed", {"mean_gap": 0.1}, "mean_gap 0.1: contact is impossible in 12 cells"),
    "negative mean gap": ("periodic", {"mean_gap": -0.1}, "mean_gap -0.1: .* allowed: at least 0 mm"),
    "mean gap above the undeformed": (
        "periodic",
        {"approach": MEAN + 1e-6},
        "negative; allowed: at most 5.00",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(solvers, name):
    which, given, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        solvers[which].solve(**given)


@pytest.mark.parametrize(
    "given", [{"mean_gap": 0}, {"mean_gap": -1e-19}, {"approach": MEAN}, {"approach": np.nextafter(MEAN, 9)}]
)
def test_up_to_full_contact_is_allowed(solvers, given):
    loading = solvers["periodic"]._loading(dict.fromkeys(LOADINGS) | given)
    assert loading.approach == pytest.approx(MEAN, abs=1e-14)


@pytest.mark.parametrize("name", ["free", "holed"])
def test_other_patches_take_any_approach(solvers, name):
    assert solvers[name]._loading({"approach": 9.0}).approach == 9.0
