"""Contact with a hardness: closed forms, limits, edge cases, and random problems against the dense solver.

``CONTACT_EXAMPLES=2000 python -m pytest tests/validation/test_hardness.py`` tries so many new random problems in each
test.
"""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from cases import capped_line, hertz, periodic_rough, punch, self_affine
from hypothesis import given

from app import ContactProblem, ContactSolver, Grid, InputError, Material
from app.reference import CappedSphere, CappedWestergaard
from app.verification.dense import DenseProblem
from app.verification.solving import random_problem, solved

from .test_properties import assert_right_or_says_not, problems, some

E_STAR, RADIUS = 1000.0, 10.0
TIGHT = {"lcp_rtol": 1e-8}
METHODS = None, "norm", "mg_v11", "fmg_v11", "fmg_lift"
each_patch = pytest.mark.parametrize("periodic", ["", "spectral"])


# -- closed forms ---------------------------------------------------------------------------------------


def line_contact(contact, a, cells):
    """Solve a line contact on some cells in 2.6 a, under its load, on a patch one cell wide and eight times as long.

    The other periods bend the surface by 2 pi F / (3 E* L^2) at most, up to (a/L)^4, which the shape makes up for.
    """
    dx = 2.6 * a / cells
    length = 8 * cells * dx
    x = (np.arange(8 * cells) + 0.5) * dx - length / 2
    curvature = 1 / contact.radius - 2 * np.pi * contact.load / (3 * contact.e_star * length**2)
    problem = ContactProblem(
        Grid(8 * cells, 1, dx, dx),
        Material.from_contact_modulus(contact.e_star),
        (curvature * x**2 / 2)[None],
        periodic="love",
        hardness=contact.hardness,
    )
    return x, dx, solved(problem, options=TIGHT, mean_pressure=contact.load / length)


@pytest.mark.parametrize("cells", [64, 128, 256, 512, 1024])
@pytest.mark.parametrize("k", [0.3, 0.7, 0.95])
def test_line_contact_has_its_closed_form(k, cells):
    contact = capped_line(RADIUS, E_STAR, 1.0, k)
    x, dx, found = line_contact(contact, 1.0, cells)
    p, exact, hardness = found.pressure[0], contact.pressure(x), contact.hardness
    assert found.converged and p.max() == hardness
    a, c = np.count_nonzero(p) * dx / 2, np.count_nonzero(p == hardness) * dx / 2
    assert max(abs(a - 1), abs(c - k)) <= 0.55 * dx
    assert abs(p - exact).sum() <= 0.1 * dx * exact.sum()
    assert np.linalg.norm(p - exact) <= 0.6 * dx * np.linalg.norm(exact)
    assert abs(p - exact).max() <= 0.5 * np.sqrt(dx) * hardness
    away = (abs(abs(x) - 1) > 0.1) & (abs(abs(x) - k) > 0.1)
    assert abs(p - exact)[away].max() <= 2 * dx**2 * hardness + 1e-4 * hardness
    if k > 0.5:  # more than a few plastic cells
        assert found.plastic_depth.max() == pytest.approx(contact.max_plastic_depth, rel=dx**2 + 1e-4)
        assert found.plastic_volume / dx == pytest.approx(contact.plastic_volume, rel=dx**2 + 1e-4)


@pytest.mark.parametrize("symbol", ["spectral", "love"])
@pytest.mark.parametrize(
    ("hardness", "share"), [(0.5, 0.2), (1.0, 0.5), (1.9, 0.94), (1.5, 0.95), (1.5, 0.5)]
)
def test_waves_have_their_closed_form(hardness, share, symbol):
    """Hardness and mean pressure over that of full contact; the last two have no open, and no plastic part."""
    full, n = np.pi * E_STAR * 0.01, 512
    contact = CappedWestergaard(0.01, 1.0, E_STAR, share * full, hardness * full)
    x = (np.arange(n) + 0.5) / n - 0.5
    problem = ContactProblem(
        Grid(n, 1, 1 / n, 1 / n),
        Material.from_contact_modulus(E_STAR),
        contact.undeformed_distance(x, 0)[None],
        periodic=symbol,
        hardness=contact.hardness,
    )
    found = solved(problem, options=TIGHT, mean_pressure=contact.mean_pressure)
    p, exact = found.pressure[0], contact.pressure(x, 0)
    assert found.converged
    assert abs(p - exact).sum() <= exact.sum() / n
    assert abs(found.contact_fraction - contact.contact_fraction) <= 2 / n
    assert abs(found.plastic_fraction - contact.plastic_fraction) <= 2 / n
    for name in ("approach", "mean_gap", "mean_plastic_depth"):
        assert abs(getattr(found, name) - getattr(contact, name)) <= 0.1 / n * 0.01, name
    assert abs(found.plastic_depth.max() - contact.max_plastic_depth) <= 0.1 / n * 0.01
    again = solved(problem, options=TIGHT, approach=found.approach)
    assert abs(again.mean_pressure - found.mean_pressure) <= 1e-4 * found.mean_pressure


@pytest.mark.parametrize("share", [0.9, 0.5, 0.2])
def test_sphere_agrees_with_rings(share):
    approach, width = 0.01, 1.2 * np.sqrt(2 * RADIUS * 0.01)
    top = 2 * E_STAR / np.pi * np.sqrt(approach / RADIUS)
    rings = CappedSphere(RADIUS, E_STAR, share * top, approach, 200)
    grid = Grid.from_domain(96, 96, (-width, width, -width, width))
    x, y = grid.x(), grid.y()[:, None]
    problem = ContactProblem(
        grid, Material.from_contact_modulus(E_STAR), (x**2 + y**2) / (2 * RADIUS), hardness=rings.hardness
    )
    found = solved(problem, options={"lcp_rtol": 1e-6}, approach=approach)
    assert found.converged and found.max_pressure == rings.hardness
    for name, most in {"load": 0.01, "plastic_volume": 0.01, "contact_area": 0.03}.items():
        assert getattr(found, name) == pytest.approx(getattr(rings, name), rel=most), name
    assert found.plastic_depth.max() == pytest.approx(rings.max_plastic_depth, rel=0.01)
    assert abs(found.plastic_area - rings.plastic_area) <= 0.03 * rings.contact_area


# -- limits ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@each_patch
def test_least_approach_if_all_contact_is_plastic(periodic, method):
    """The lower half of the cells carries the load at the hardness; the others are far away."""
    grid, low = (
        Grid.from_domain(12, 10, (0, 12, 0, 10)),
        np.add.outer(np.arange(10) // 2, np.arange(12) // 3) % 2 == 0,
    )
    gap = np.where(low, 0, 5) + 0.01 * np.random.default_rng(1).random(grid.shape)
    hardness = np.where(low, 0.03, 0.02)
    problem = ContactProblem(
        grid, Material.from_contact_modulus(1.0), gap, periodic=periodic, hardness=hardness
    )
    found = solved(problem, method, load=grid.cell_area * hardness[low].sum())
    assert found.converged
    np.testing.assert_array_equal(found.pressure, np.where(low, hardness, 0))
    shape_and_u = gap + found.displacement
    assert found.approach == pytest.approx(shape_and_u[low].max(), rel=1e-13)
    assert found.approach < shape_and_u[~low].min() - 1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("make", [hertz, punch, self_affine, periodic_rough])
def test_hardness_that_no_pressure_reaches_changes_nothing(make, method):
    problem = make(32)
    by_load = solved(problem, method, mean_pressure=50.0)
    for loading in {"mean_pressure": 50.0}, {"approach": by_load.approach}:
        elastic = solved(problem, method, **loading)
        hard = solved(replace(problem, hardness=10 * elastic.max_pressure), method, **loading)
        np.testing.assert_array_equal(hard.pressure, elastic.pressure)
        assert hard.operator_applications == elastic.operator_applications
        assert hard.approach == elastic.approach
        assert not hard.plastic.any() and hard.plastic_area == hard.plastic_volume == 0


@pytest.mark.parametrize("make", [hertz, self_affine, periodic_rough])
def test_hardness_just_above_the_largest_pressure_leaves_the_solution(make):
    problem = make(32)
    elastic = solved(problem, options=TIGHT, mean_pressure=50.0)
    hard = solved(
        replace(problem, hardness=(1 + 1e-6) * elastic.max_pressure), options=TIGHT, mean_pressure=50.0
    )
    np.testing.assert_allclose(hard.pressure, elastic.pressure, rtol=0, atol=1e-5 * elastic.max_pressure)


@pytest.mark.parametrize("make", [hertz, self_affine, periodic_rough])
def test_soft_bodies_touch_where_they_overlap(make):
    """The bearing area is plastic, and the load is H times this area."""
    problem = make(32)
    h = problem.shape_on(problem.grid)
    soft = replace(problem, hardness=1e-9 * problem.material.contact_modulus)
    approach = np.nanquantile(h, 0.3 if problem.grid.periodic else 0.1)
    approach = (approach + h[h > approach].min()) / 2
    found = solved(soft, approach=approach)
    np.testing.assert_array_equal(found.plastic, h < approach)
    assert found.converged and found.load == pytest.approx(soft.hardness * found.plastic_area, rel=1e-12)
    assert found.contact_area == found.plastic_area
    by_load = solved(soft, load=found.load * 1.0000001)  # the next lowest cells carry little
    assert by_load.converged and by_load.contact_cells > found.contact_cells
    np.testing.assert_array_equal(by_load.plastic, found.plastic)


# -- edge cases -----------------------------------------------------------------------------------------


def rough_problem(periodic, hardness, holes=False, seed=0):
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, 7, 6, periodic, holes=False)
    gap = problem.gap.copy()
    if holes:
        gap[rng.random(gap.shape) < 0.2] = np.nan
    return ContactProblem(problem.grid, problem.material, gap, periodic=periodic, hardness=hardness)


def fields_of_hardness(shape):
    rng = np.random.default_rng(1)
    return {
        "number": 0.05,
        "random": 0.02 + 0.1 * rng.random(shape),
        "half": np.where(np.arange(shape[1]) < shape[1] / 2, 0.05, 0.1) + np.zeros(shape),
    }


@each_patch
@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("kind", ["number", "random", "half"])
@pytest.mark.parametrize("method", [None, "norm", "fmg_v11"])
def test_largest_load_is_met_by_plastic_cells_alone(method, kind, holes, periodic):
    problem = rough_problem(periodic, fields_of_hardness((6, 7))[kind], holes)
    dense, inside = DenseProblem(problem), ~np.isnan(problem.gap)
    hardness = np.broadcast_to(problem.hardness, inside.shape)
    largest = dense.largest_load
    exact, approach = dense.under(largest, 0.0)
    for load in largest, np.nextafter(largest, 0), np.nextafter(largest, np.inf):
        try:
            found = solved(problem, method, load=load)
        except InputError as error:
            assert method == "fmg_v11" and "halved" in str(error)
            return
        assert found.converged, found.message
        np.testing.assert_array_equal(found.pressure, exact.astype(float))
        assert found.plastic[inside].all() and found.error_bound <= 1e-9
        assert found.approach == pytest.approx(approach, rel=1e-12)
        assert found.load == load
        assert (found.plastic_depth[inside] >= 0).all()
    for less in 1e-12, 1e-9, 1e-6, 0.5 / inside.sum():
        found = solved(problem, method, load=largest * (1 - less))
        exact, _ = dense.under(largest * (1 - less), found.approach)
        assert (found.pressure <= hardness).all()
        if method is None:
            assert found.converged, found.message
            error = abs(found.pressure - exact).max()
            assert error <= (0.01 * less + 2e-12) * hardness[inside].sum()
    with pytest.raises(InputError, match="must be at most") as error:
        solved(problem, method, load=1.0001 * largest)
    assert "\n" not in str(error.value)


@each_patch
@pytest.mark.parametrize("method", [None, "norm"])
def test_plateaus_without_elastic_cells_have_an_interval_of_approaches(method, periodic):
    """Two terraces far apart: the lower one is plastic before the upper one touches."""
    gap = np.where(np.arange(36).reshape(6, 6) % 4 < 2, 0.0, 1.0)
    problem = ContactProblem(
        Grid(6, 6, 0.1, 0.1), Material.from_contact_modulus(1.0), gap, periodic=periodic, hardness=1e-3
    )
    lower, area = gap == 0, problem.grid.cell_area
    load, dense = 1e-3 * area * lower.sum(), DenseProblem(problem)
    _, smallest = dense.under(load, 0.5)
    found = solved(problem, method, load=load)
    np.testing.assert_allclose(found.pressure, np.where(lower, 1e-3, 0.0), rtol=0, atol=1e-17)
    assert found.converged and smallest - 1e-9 <= found.approach <= 1.0
    for approach in 0.3, 0.45:  # a periodic patch is full at 0.5
        found = solved(problem, method, approach=approach)
        np.testing.assert_array_equal(found.plastic, lower)
        assert found.load == pytest.approx(load, rel=1e-12)
    for other in 1.2 * load, 0.8 * load:
        found = solved(problem, method, options=TIGHT, load=other)
        assert found.converged and found.load == other
        exact, _ = dense.under(other, found.approach)
        np.testing.assert_allclose(found.pressure, exact.astype(float), rtol=0, atol=1e-4 * 1e-3)


@each_patch
def test_a_single_cell_in_contact_is_capped(periodic):
    gap = np.full((4, 4), 10.0)
    gap[1, 2] = 0.0
    problem = ContactProblem(
        Grid(4, 4, 0.1, 0.1), Material.from_contact_modulus(1.0), gap, periodic=periodic, hardness=2.0
    )
    area = problem.grid.cell_area
    half, full = solved(problem, load=area), solved(problem, load=2 * area)
    assert half.converged and half.contact_cells == 1 and not half.plastic.any()
    assert full.converged and full.plastic.sum() == np.count_nonzero(full.pressure > 1e-12) == 1
    assert full.pressure[1, 2] == 2.0
    deep = solved(problem, approach=5.0)
    assert deep.converged and deep.plastic_depth[1, 2] == pytest.approx(
        5.0 - deep.displacement[1, 2], rel=1e-12
    )
    alone = ContactProblem(
        Grid(1, 1, 0.1, 0.1), Material.from_contact_modulus(1.0), np.zeros((1, 1)), hardness=2.0
    )
    assert solved(alone, approach=1.0).pressure == solved(alone, load=2 * area).pressure == 2.0


@pytest.mark.parametrize("wrong", [0, -1.0, np.nan, "hard", np.zeros((4, 4)), np.ones((4, 3))])
def test_wrong_hardnesses_are_refused(wrong):
    with pytest.raises(InputError, match="hardness") as error:
        ContactProblem(
            Grid(4, 4, 0.1, 0.1), Material.from_contact_modulus(1.0), np.zeros((4, 4)), hardness=wrong
        )
    assert "\n" not in str(error.value)


@each_patch
@pytest.mark.parametrize("method", [None, "norm"])
def test_a_patch_may_be_half_elastic(method, periodic):
    """The elastic half carries any load; a limit of inf everywhere is none."""
    problem = rough_problem(periodic, None)
    elastic = solved(problem, method, options=TIGHT, load=1.0)
    hardness = np.where(np.arange(7) < 3, 0.2 * elastic.max_pressure, np.inf) + np.zeros((6, 7))
    for load in 0.1, 1.0, 10.0:
        half = replace(problem, hardness=hardness)
        found = solved(half, method, options=TIGHT, load=load)
        exact, _ = DenseProblem(half).under(load, found.approach)
        assert found.converged, found.message
        np.testing.assert_allclose(found.pressure, exact.astype(float), rtol=0, atol=1e-6 * exact.max())
        assert found.plastic[:, 3:].sum() == 0
    unlimited = solved(replace(problem, hardness=np.full((6, 7), np.inf)), method, options=TIGHT, load=1.0)
    np.testing.assert_array_equal(unlimited.pressure, elastic.pressure)


@pytest.mark.parametrize("method", [None, "norm"])
def test_approaches_beyond_full_contact_are_plastic(method):
    problem = rough_problem("spectral", None)
    full = solved(problem, method, options=TIGHT, approach=problem.gap.mean())
    hard = replace(problem, hardness=0.7 * full.max_pressure)
    highest = problem.gap.max()
    for approach in 1.1 * problem.gap.mean(), 0.5 * (problem.gap.mean() + highest), 3 * highest:
        found = solved(hard, method, options=TIGHT, approach=approach)
        exact = DenseProblem(hard).at(approach).astype(float)
        assert found.converged, found.message
        np.testing.assert_allclose(found.pressure, exact, rtol=0, atol=1e-6 * exact.max())
    assert found.plastic.all()


# -- random problems ------------------------------------------------------------------------------------


@st.composite
def limited(draw, periodic):
    """A small problem with a hardness, a loading and a tolerance."""
    problem, loading, rtol = draw(problems(periodic))
    dense, gap = DenseProblem(problem), problem.gap
    if "approach" in loading:
        top = float(dense.at(loading["approach"]).max())
    else:
        top = float(dense.under(loading["load"], np.nanmean(gap))[0].max())
    top = top or 0.1 * problem.material.contact_modulus
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    share = draw(st.sampled_from([2.0, 0.9, 0.5, 0.2, 0.05, 1e-3]))
    x = rng.random(gap.shape)
    kind = draw(st.sampled_from(["number", "random", "half", "mixed", "spots", "two"]))
    hardness = {
        "number": share,
        "random": share * (0.01 + x),
        "half": np.where(np.arange(gap.shape[1]) < gap.shape[1] / 2, share, np.inf) + 0 * x,
        "mixed": np.where(x < 0.5, share * (0.5 + x), np.inf),
        "spots": np.where(x < 0.02, share, np.inf),
        "two": np.where(x < 0.3, share, 3 * share),
    }[kind]
    problem = replace(problem, hardness=hardness * top)
    largest, mean = DenseProblem(problem).largest_load, np.nanmean(gap)
    if "load" in loading and np.isfinite(largest):
        fractions = [1e-6, 0.01, 0.3, 0.7, 0.95, 0.99, 1 - 1e-6, 1 - 1e-9, 1 - 1e-12, 1 - 1e-15, 1.0]
        loading = {"load": draw(st.sampled_from(fractions)) * largest}
    elif "approach" in loading and periodic and not np.isnan(gap).any():
        other = draw(st.sampled_from(["approach", "beyond", "mean_gap"]))
        if other == "beyond" and np.isfinite(np.inf if problem.hardness is None else problem.hardness).any():
            loading = {"approach": mean + draw(st.sampled_from([0.1, 0.5, 2.0])) * (np.ptp(gap) or 1.0)}
        elif other == "mean_gap" and loading["approach"] < mean - 1e-9 * abs(mean):
            loading = {"mean_gap": mean - loading["approach"]}
        elif abs(loading["approach"] - mean) <= 1e-14 * abs(mean):
            loading = {"approach": mean}  # closer approaches count as full contact
    return problem, loading, rtol


@some
@given(limited(periodic=False))
def test_default_method_on_free_patches(case):
    assert_right_or_says_not(*case)


@some
@given(limited(periodic=True))
def test_default_method_on_periodic_patches(case):
    assert_right_or_says_not(*case)


@some
@given(
    st.booleans().flatmap(lambda periodic: limited(periodic=periodic)),
    st.sampled_from(["norm", "mg_v11", "fmg_v11", "fmg_lift"]),
)
def test_other_methods(case, method):
    assert_right_or_says_not(*case, method)


@pytest.mark.parametrize("periodic", ["spectral", "love", "x", ""])
@pytest.mark.parametrize("hardness", [1e-9, 4e-7, 1e-5])
def test_approaches_at_the_level_of_a_plateau_are_solved(hardness, periodic):
    """Near the highest plateau the pressure differs from the hardness by the few last digits of the approach."""
    n, rng = 8, np.random.default_rng(1)
    gap = 0.025 * rng.integers(0, 6, (n, n))
    grid = Grid(n, n, 1 / n, 1 / n, periodic=periodic)
    problem = ContactProblem(grid, Material.from_contact_modulus(1.0), gap, hardness=hardness)
    dense = DenseProblem(problem)
    with ContactSolver(problem) as solver:
        for level in np.unique(gap)[[1, 3, -1]]:
            for ulps in (0, 1, -1, -6, -60, -6e3):
                approach = level + ulps * np.spacing(level)
                solution = solver.solve(approach=approach)
                expected = dense.at(approach)
                assert solution.converged, (level, ulps, solution.message)
                found = solution.pressure
                if grid.doubly_periodic:  # constants have no energy, but rounding has
                    found, expected = found - found.mean(), expected - expected.mean()
                # The bound of a constant pressure is relative to the rounding of its energy.
                rounding = np.sqrt(np.spacing(1.0) * dense.matrix[0, 0] * grid.n) * hardness
                size = max(dense.energy(found), rounding if grid.doubly_periodic else 0.0)
                assert dense.energy(found - expected) <= solution.error_bound * size + 1e-16 * hardness


@pytest.mark.parametrize("periodic", ["spectral", "love"])
def test_mean_gap_and_load_of_full_plasticity_are_those_of_its_approach(periodic):
    rng, n = np.random.default_rng(2), 8
    gap = 0.31 + 0.025 * rng.integers(0, 6, (n, n))
    grid = Grid(n, n, 1 / n, 1 / n, periodic=periodic)
    problem = ContactProblem(grid, Material.from_contact_modulus(1.0), gap, hardness=4e-7)
    with ContactSolver(problem) as solver:
        by_load = solver.solve(load=4e-7)
        for approach in (by_load.approach, gap.max(), 2 * gap.max()):
            solution = solver.solve(approach=approach)
            assert solution.converged and (solution.pressure == 4e-7).all() and solution.error_bound == 0
            assert solution.approach == approach and solution.load == by_load.load
