"""Contact on periodic patches: all methods find the same, that of the dense problem; invariances; full contact."""

import numpy as np
import periodic
import pytest
from running import assert_solves_lcp, solve

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere

TIGHT = {"lcp_rtol": 1e-9}
CIRCULANT = {
    "pc_type": "python",
    "pc_python_type": "app.methods.free.circulant.Circulant",
    "pc_circulant_extend": 3,
}
METHODS = {
    "default": (None, {}),
    "default, double precision": (None, {"lcp_precision": "double"}),
    "default, one grid": (None, {"lcp_nested": "false"}),
    "NORM": ("norm", {}),
    "NORM, circulant": ("norm", CIRCULANT),
    "MG": ("mg_v11", {}),
    "FMG": ("fmg_v11", {}),
    "FMG, lift": ("fmg_lift", {}),
    "SNESVI": (None, {"lcp_type": "snesvi"}),
}
PROBLEMS = {
    "even": periodic.rough(16, 12, 1),
    "one direction odd": periodic.rough(18, 11, 2, symbol="love"),
    "holes": periodic.rough(12, 16, 3, holes=0.06),
    "odd, holes": periodic.rough(13, 9, 4, holes=0.06, symbol="love"),
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
@pytest.mark.parametrize(("method", "options"), METHODS.values(), ids=METHODS.keys())
def test_all_methods_solve_the_dense_problem_by_approach_and_by_load(problem, method, options):
    bound_constrained = "lcp_type" in options
    cannot_halve = problem.grid.nx % 2 and problem.grid.ny % 2
    if cannot_halve and method and "mg" in method:
        return
    with ContactSolver(problem, method, TIGHT | options) as solver:
        for share in (0.3, 0.8, 0.98):
            approach = share * np.nanmean(problem.gap)
            expected, _ = periodic.by_pivoting(problem, approach)
            found = solver.solve(approach=approach)
            if not bound_constrained:
                assert_solves_lcp(found, 1e-9)
                assert found.fallbacks == 0
            size = expected.max()
            np.testing.assert_allclose(found.pressure, expected, rtol=0, atol=1e-6 * size)
            assert found.error_bound < 1e-6
            if not bound_constrained:
                by_load = solver.solve(load=found.load)
                assert_solves_lcp(by_load, 1e-9)
                assert by_load.load == pytest.approx(found.load, rel=1e-12)
                np.testing.assert_allclose(by_load.pressure, expected, rtol=0, atol=1e-6 * size)
                assert by_load.approach == pytest.approx(approach, rel=1e-7)


each_method = pytest.mark.parametrize("method", [None, "norm", "fmg_v11"], ids=["default", "NORM", "FMG"])


@each_method
def test_loads_up_to_full_contact_and_beyond(method):
    problem = periodic.rough(32, 32, 7, noise=0.001)
    with ContactSolver(problem, method) as solver:
        full = solver.solve(approach=problem.gap.mean())
        before = 0.0
        for share in (0.5, 0.9, 0.99, 0.9999):
            found = solver.solve(load=share * full.load)
            assert_solves_lcp(found)
            assert found.load == pytest.approx(share * full.load, rel=1e-12)
            assert before < found.approach < problem.gap.mean()
            before = found.approach
        assert full.contact.all() and found.contact_fraction > 0.99


@pytest.mark.parametrize("height", [1e-12, 1e-5, 1.3, 3.7])
@pytest.mark.parametrize("n", [12, 24])
def test_what_is_nothing_but_rounding_is_0_and_what_is_little_is_not(n, height):
    """Gaps about 0 mm: full contact is at approach 0."""
    grid, material = Grid.from_domain(n, n, (0, 1, 0, 1), periodic=True), Material.from_contact_modulus(1e5)
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = height * (np.cos(2 * np.pi * x + 0.3) + np.cos(2 * np.pi * y) ** 2 - 0.5)
    with ContactSolver(ContactProblem(grid, material, gap)) as solver:
        for loading in ({"mean_gap": 0}, {"approach": 0}, {"mean_pressure": 1e8 * height}):
            found = solver.solve(**loading)
            assert found.contact.all() and found.approach == found.mean_gap == 0
        found = solver.solve(mean_gap=1e-8 * height)
        assert found.approach == pytest.approx(-1e-8 * height, rel=1e-6, abs=0)
        assert found.mean_gap == pytest.approx(1e-8 * height, rel=1e-6, abs=0)


@pytest.mark.parametrize("method", [None, "norm"], ids=["default", "NORM"])
def test_a_small_contact_in_a_large_period_is_one_on_a_free_patch(method):
    """Images of a force F add, at a distance, F / (pi E*) (-3.900 / L + ...): sum of 1/r over a square lattice."""
    errors, lattice = [], -3.900264920001956
    for cells in (48, 96):
        grid = Grid.from_domain(cells, cells, (-cells / 2, cells / 2, -cells / 2, cells / 2))
        sphere = ContactProblem(grid, Material.combined(1.0, 0.0), Sphere(50.0))
        alone = solve(sphere, 0.5, "norm", lcp_rtol=1e-9)
        shape = sphere.shape_on(grid)
        images = ContactProblem(grid, sphere.material, shape, periodic="love")
        among = solve(images, None, method, load=alone.load, lcp_rtol=1e-9)
        moved = among.approach - alone.approach
        expected = alone.load * sphere.material.compliance * lattice / cells
        errors.append(abs(moved - expected) / abs(expected))
        assert abs(among.pressure - alone.pressure).max() <= 0.02 * alone.max_pressure * (48 / cells) ** 3
    assert errors[0] < 0.02 and errors[1] < errors[0] / 3


@each_method
def test_an_approach_beyond_full_contact_of_the_coarse_grids_is_kept(method):
    """Fine holes are none on coarse grids, where contact is full at less."""
    gap = np.random.default_rng(3).random((8, 64))
    gap[np.random.default_rng(4).random(gap.shape) < 0.4] = np.nan
    problem = ContactProblem(Grid(64, 8, 0.1, 0.1), Material.combined(1.0, 0.0), gap, periodic=True)
    expected, _ = periodic.by_pivoting(problem, 50.0)
    found = solve(problem, 50.0, method, lcp_rtol=1e-8)
    assert_solves_lcp(found, 1e-7)
    np.testing.assert_allclose(found.pressure, expected, rtol=0, atol=1e-5 * expected.max())


@pytest.mark.parametrize("method", ["mg_v11", "fmg_v11", "fmg_lift", "fmg_fft"])
def test_multigrid_down_to_a_few_cells(method):
    """A single cell of a period has no influence, and is no coarsest grid."""
    problem = periodic.rough(16, 12, 2)
    found = solve(problem, 0.5 * problem.gap.mean(), method, lcp_coarsest=1)
    assert_solves_lcp(found)
    assert found.error_bound < 1e-2
    with pytest.raises(
        InputError, match="2,2 cannot be halved; it must have at least 3 cells in a direction"
    ):
        solve(periodic.rough(2, 2, 1), 1e-3, method)
