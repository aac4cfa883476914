"""The default method on periodic patches: its work, its accuracy, its safeguard."""

import warnings
from functools import cache

import numpy as np
import periodic
import pytest
from running import assert_solves_lcp, solve

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface
from app.methods import progress
from app.verification.dense import DenseProblem
from app.verification.solving import solved

MATERIAL = Material.combined(1.0, 0.0)
MOST = 30  # operator applications; measured: 7 to 30
SURFACES = ["smooth", "self-affine", "white noise", "ties"]


@cache
def surface(kind, n, ny=None, symbol="spectral"):
    """A unit patch."""
    grid = Grid(n, ny or n, 1 / n, 1 / (ny or n))
    x, y = np.meshgrid(grid.x(), grid.y())
    if kind == "smooth":
        height = 0.01 * (
            np.cos(2 * np.pi * x) + np.cos(4 * np.pi * y + 1) + 0.5 * np.cos(6 * np.pi * (x - y))
        )
    elif kind == "self-affine":
        height = SelfAffineSurface(0.8, 0.25, 1 / 16, (1.0, 1.0), 3, rms_slope=0.1).height(grid.x(), grid.y())
    elif kind == "white noise":
        height = 0.001 * np.random.default_rng(4).normal(size=grid.shape)
    elif kind == "ties":  # sixteen summits alike
        height = 0.01 * (np.cos(8 * np.pi * x) + np.cos(8 * np.pi * y))
    return ContactProblem(grid, MATERIAL, height.max() - height, periodic=symbol)


def pressed_to(problem, share, solver):
    """By the share of the mean pressure that full contact needs."""
    return solver.solve(load=share * full_load(problem))


def full_load(problem):
    grid = problem.grid
    q = 2 * np.pi * np.hypot(np.fft.fftfreq(grid.ny, grid.dy)[:, None], np.fft.fftfreq(grid.nx, grid.dx))
    p = np.fft.ifft2(-problem.material.contact_modulus / 2 * q * np.fft.fft2(problem.gap)).real
    return -p.min() * grid.area


@pytest.mark.parametrize("share", [0.02, 0.4])
def test_no_number_of_cells_is_dear(share):
    """Odd ones, and primes, cost what powers of two do."""
    counts = []
    for nx, ny in ((128, 128), (127, 127), (125, 128), (122, 131)):
        problem = surface("self-affine", nx, ny)
        with ContactSolver(problem) as solver:
            counts.append(pressed_to(problem, share, solver).operator_applications)
    assert max(counts) <= 1.25 * counts[0]


@pytest.mark.parametrize("kind", SURFACES)
def test_work_does_not_grow_with_the_grid_nor_with_the_contact(kind):
    fractions, counts = [], []
    for n in (64, 128, 256):
        with ContactSolver(surface(kind, n)) as solver:
            for share in (0.003, 0.05, 0.4, 0.9):
                found = pressed_to(surface(kind, n), share, solver)
                assert found.converged and found.fallbacks == 0
                by_approach = solver.solve(approach=found.approach)
                assert by_approach.load == pytest.approx(found.load, rel=1e-4)
                counts += [found.operator_applications, by_approach.operator_applications]
                fractions.append(found.contact_fraction)
    assert min(fractions) < 0.05 and max(fractions) > 0.9
    assert max(counts) <= MOST, counts


@pytest.mark.parametrize("holes", [0.0, 0.1])
def test_tolerances_tight_and_loose(holes):
    problem = periodic.rough(32, 32, 5, holes)
    approach = 0.8 * np.nanmean(problem.gap)
    exact = solve(problem, approach, None, lcp_rtol=1e-12)
    before = 0
    for rtol in (1e-10, 1e-8, 1e-6, 1e-4, 1e-2):
        found = solve(problem, approach, None, lcp_rtol=rtol)
        if found.converged:
            assert found.fallbacks == 0
            off = np.linalg.norm(found.pressure - exact.pressure) / np.linalg.norm(exact.pressure)
            assert off <= max(1e3 * rtol, 1e-9) and off <= 0.1
            deviation = np.nanstd(problem.gap)
            assert np.sqrt(np.mean(found.gap[found.contact] ** 2)) <= rtol * deviation
        else:
            assert rtol > 1e-4 and "proved" in found.message
        assert before == 0 or found.operator_applications <= before
        before = found.operator_applications


def test_any_unit_of_length_and_pressure():
    problem, answers = periodic.rough(24, 24, 6, holes=0.05), []
    grid = problem.grid
    for length, stress in ((1.0, 1.0), (1e-9, 1e6), (1e9, 1e-6), (1e-20, 1e20), (1e20, 1e-20)):
        there = Grid(grid.nx, grid.ny, grid.dx * length, grid.dy * length)
        scaled = ContactProblem(there, Material.combined(stress, 0.0), problem.gap * length, periodic=True)
        found = solve(scaled, 0.5 * length * np.nanmean(problem.gap), None, lcp_precision="double")
        assert found.converged
        answers.append((found.contact, found.pressure / stress, found.operator_applications))
    for contact, p, count in answers:
        assert (contact == answers[0][0]).all() and count == answers[0][2]
        np.testing.assert_allclose(p, answers[0][1], rtol=0, atol=1e-6 * p.max())


@pytest.mark.parametrize("shape", [(1, 2), (6, 8)])
def test_loads_beyond_what_full_contact_needs_take_digits_off_its_waves(shape):
    """The bound holds for what is left of them; where too little is, the answer says so."""
    gap = np.random.default_rng(4).random(shape)
    problem = ContactProblem(Grid(*shape[::-1], 1.0, 1.0), MATERIAL, gap, periodic=True)
    dense, proved = DenseProblem(problem), []
    for pressure in 10.0 ** np.arange(1, 19):
        found = solved(problem, mean_pressure=pressure)
        waves = found.pressure.astype(np.longdouble) - np.longdouble(pressure)
        exact = dense.at(gap.mean())
        error = dense.energy(waves - (exact - exact.mean()))
        assert error <= found.error_bound * dense.energy(waves) * (1 + 1e-6) or found.error_bound == np.inf
        assert found.converged == (found.error_bound <= 0.01)
        proved.append(found.converged)
    assert all(proved[:10]) and not any(proved[15:])


@pytest.mark.parametrize("method", [None, "fmg_v11"])
@pytest.mark.parametrize("symbol", ["spectral", "love"])
def test_a_mean_gap_is_kept_however_little_it_is(symbol, method):
    """Full contact is another problem, with another pressure, for which a bound would say nothing of this one."""
    gap = np.random.default_rng(5).random((12, 16))
    problem = ContactProblem(Grid(16, 12, 1.0, 1.0), MATERIAL, gap, periodic=symbol)
    dense = DenseProblem(problem)
    with ContactSolver(problem, method) as solver:
        for share in (1e-8, 1e-10, 1e-11, 1e-12, 1e-13):
            found = solver.solve(mean_gap=share * (gap.mean() - gap.min()))
            assert found.converged and not found.contact.all()
            assert found.mean_gap == pytest.approx(share * (gap.mean() - gap.min()), rel=1e-2)
            assert found.indentation + gap.min() == pytest.approx(found.approach, rel=1e-15)
            exact = dense.with_mean_gap(share * (gap.mean() - gap.min()))
            assert dense.energy(exact - found.pressure) <= found.error_bound * dense.energy(found.pressure)


@pytest.mark.parametrize("loading", ["approach", "mean_gap"])
@pytest.mark.parametrize("method", [None, "fmg_v11"])
def test_the_error_bound_counts_a_gap_that_full_contact_neglects(method, loading):
    """A gap of a few units in the last place of the mean distance."""
    gap = np.random.default_rng(5).random((12, 16))
    gap -= gap.min()
    problem = ContactProblem(Grid(16, 12, 1.0, 1.0), MATERIAL, gap, periodic="spectral")
    dense = DenseProblem(problem)
    for units in (5, 6, 8, 10):
        mean_gap = units * np.spacing(gap.mean())
        given = mean_gap if loading == "mean_gap" else gap.mean() - mean_gap
        found = solved(problem, method, options={"lcp_rtol": 1e-14}, **{loading: given})
        exact = dense.at(given) if loading == "approach" else dense.with_mean_gap(given)
        assert dense.energy(exact - found.pressure) <= found.error_bound * dense.energy(found.pressure)


def test_the_error_bound_counts_the_rounding_of_the_approach_near_full_contact():
    """A mean gap of less than that is all in the cell with the least pressure."""
    n, q = 64, 2 * np.pi * np.fft.fftfreq(64)
    x = 2 * np.pi * np.arange(n) / n
    gap = 2 + np.cos(x + 1) + 0.3 * np.cos(2 * x[:, None] + x + 2)
    problem = ContactProblem(
        Grid(n, n, 1.0, 1.0), Material.from_contact_modulus(2.0), gap, periodic="spectral"
    )
    inverse = np.hypot(q, q[:, None])
    mean_gap = 0.4 * np.spacing(gap.mean() - gap.min())
    found = solved(problem, mean_gap=mean_gap)
    waves = abs(np.fft.fft2(found.pressure)) / n
    size = np.sqrt(np.sum(np.divide(waves**2, inverse, out=np.zeros_like(waves), where=inverse > 0)))
    error = n**2 * mean_gap * np.sqrt(inverse.mean())
    assert found.contact.all() and error <= found.error_bound * size


def test_a_grid_without_any_possible_contact_is_left_out():
    """A punch that lies between the cell centres of all coarse grids."""

    def shape(x, y):
        return np.where((abs(x - 0.52) < 0.02) & (abs(y - 0.52) < 0.02), (x - 0.52) ** 2, np.nan)

    problem = ContactProblem(Grid(128, 128, 1 / 128, 1 / 128), MATERIAL, shape, periodic=True)
    for loading in ({"load": 1e-3}, {"approach": 1e-3}):
        with ContactSolver(problem) as solver:
            assert_solves_lcp(solver.solve(**loading))


def test_waves_that_lose_all_contact_on_the_way_need_no_safeguard():
    """A light load on a ridge: while the system is not solved yet no cell in contact may show a pressure."""
    grid = Grid(32, 16, 0.1, 1.0)
    gap = np.tile(8e-3 * (1 + np.cos(2 * np.pi * grid.x() / 3.2)), (16, 1))
    with ContactSolver(ContactProblem(grid, MATERIAL, gap, periodic="love")) as solver:
        for share in 10.0 ** -np.arange(1, 9):
            found = pressed_to(ContactProblem(grid, MATERIAL, gap, periodic="love"), share, solver)
            assert found.converged and found.fallbacks == 0 and found.operator_applications <= MOST


@pytest.mark.parametrize("holes", [0.0, 0.1])
@pytest.mark.parametrize("by_load", [False, True])
def test_the_safeguard_takes_over_and_is_right(monkeypatch, by_load, holes):
    problem = periodic.rough(32, 24, 8, holes)
    approach = 0.8 * np.nanmean(problem.gap)
    plain = solve(problem, approach, None, lcp_rtol=1e-8)
    monkeypatch.setattr(progress, "PATIENCE", 0)
    assert plain.fallbacks == 0
    loading = {"load": plain.load} if by_load else {"approach": approach}
    for options in ({}, {"pc_two_grid_sweeps": 1}):
        with ContactSolver(problem, options={"lcp_rtol": 1e-8, "lcp_coarse_rtol": 1e-9} | options) as solver:
            found = solver.solve(**loading)
        # What meets the load in the end is not asked again.
        assert_solves_lcp(found, 4e-8 if by_load else 1e-8)
        assert found.fallbacks >= 1
        assert found.approach == pytest.approx(approach, rel=1e-6)
        np.testing.assert_allclose(found.pressure, plain.pressure, rtol=0, atol=1e-5 * plain.max_pressure)


@pytest.mark.parametrize("nested", [0, 1])
@pytest.mark.parametrize("by_load", [False, True])
def test_a_limit_on_iterations_is_kept_and_said(by_load, nested):
    """And what is left is a state of contact: p >= 0, u = A p, the load or the approach that was asked for."""
    problem = periodic.rough(32, 24, 8)
    exact = solve(problem, 0.8 * problem.gap.mean(), None)
    load = exact.load if by_load else None
    found = solve(problem, exact.approach, None, load, lcp_max_it=1, lcp_nested=nested)
    assert not found.converged and "1 active set iterations were not enough" in found.message
    assert found.pressure.min() >= 0 and found.residual > 1e-6
    if by_load:
        assert found.load == pytest.approx(load, rel=1e-12)
        assert abs(found.approach - exact.approach) < 0.2 * problem.gap.std()
    else:
        assert found.mean_gap == pytest.approx(exact.mean_gap, rel=1e-12)
    assert found.gap.mean() == pytest.approx(problem.gap.mean() - found.approach, rel=1e-12)
    # The bound is one: in the energy norm, in which a constant pressure counts nothing.
    waves = np.fft.fft2(found.pressure - exact.pressure), np.fft.fft2(exact.pressure)
    q = np.hypot(*np.meshgrid(np.fft.fftfreq(32, problem.grid.dx), np.fft.fftfreq(24, problem.grid.dy)))
    off, whole = (np.linalg.norm(wave[q > 0] / np.sqrt(q[q > 0])) for wave in waves)
    assert off <= found.error_bound * whole * 1.001


def test_coarse_grids_are_solved_to_rounding_at_most():
    problem = surface("self-affine", 128)
    found = solve(problem, 0.5 * problem.gap.mean(), None, lcp_coarse_rtol=0)
    assert found.converged and found.operator_applications < 25


@pytest.mark.parametrize("below", [0.0, 1e-9, 1.0])
def test_bodies_that_just_touch_or_do_not(below):
    """Any pressure would be one of rounding alone."""
    gap = 1.0 + np.random.default_rng(5).integers(0, 3, (2, 16))
    found = solve(ContactProblem(Grid(16, 2, 0.1, 0.1), MATERIAL, gap, periodic="love"), 1.0 - below, None)
    assert found.converged and found.load == found.error_bound == 0
    assert not found.contact.any()


def test_no_warning_comes_from_the_arithmetic():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for share in (0.0, 1e-9, 0.01, 0.999999):
            problem = periodic.rough(16, 16, 4)
            assert solve(problem, share * problem.gap.mean(), None).converged


@pytest.mark.parametrize(("ny", "aspect"), [(4, 0.125), (4, 0.3), (8, 0.06), (2, 0.05)])
def test_few_rows_of_long_cells(ny, aspect):
    """The highest eigenvalues of the sweeps' stencil are beyond those that sweeps of usual lengths damp."""
    side = 1 / np.sqrt(128 * ny * aspect)
    grid = Grid(128, ny, side, side * aspect)
    gap = 0.01 * np.random.default_rng(1).standard_normal((ny, 128))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), gap, periodic=True)
    by_load = solve(problem, None, None, 100.0)
    for found in (by_load, solve(problem, by_load.approach, None)):
        assert found.converged and not found.fallbacks
        assert found.operator_applications < 120


def test_a_load_on_a_flat_punch_asks_for_no_more_than_its_approach():
    grid = Grid(256, 256, 1 / 256, 1 / 256)
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = np.where((abs(x - 0.5) < 0.2) & (abs(y - 0.5) < 0.2), 0.0, np.nan)
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), gap, periodic=True)
    by_load = solve(problem, None, None, 100.0)
    by_approach = solve(problem, by_load.approach, None)
    assert by_load.converged and by_approach.converged
    assert by_load.operator_applications <= 1.6 * by_approach.operator_applications


def test_nearly_full_contact_of_odd_grids():
    grid = Grid(255, 255, 1 / 255, 1 / 255)
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = 0.01 * (2 - np.cos(6 * np.pi * x) - np.cos(4 * np.pi * y))
    with ContactSolver(ContactProblem(grid, MATERIAL, gap, periodic=True)) as solver:
        for share in (0.9, 0.99, 0.9999):
            found = solver.solve(approach=share * gap.mean())
            assert found.converged and not found.fallbacks
            assert found.operator_applications < 15


@pytest.mark.parametrize("n", [51, 101, 64])
def test_light_loads_on_peaks_alike(n):
    """Wherever cells of coarse grids lie on them: what touches first on one is a peak of several on the next."""

    def gap(x, y):
        return 0.01 * (2 - np.cos(6 * np.pi * x) - np.cos(4 * np.pi * y))

    grid = Grid(n, n, 1 / n, 1 / n)
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), gap, periodic=True)
    with ContactSolver(problem) as solver:
        for load in (1e-6, 1e-4, 1e-2):
            found = solver.solve(load=load)
            assert found.converged and not found.fallbacks
            assert found.operator_applications < 40


@pytest.mark.parametrize(("cut_off", "more"), [(1, 11), (2, 9), (0, 25.3)], ids=["one", "two", "noise"])
def test_light_loads_take_little_more_than_their_approach(cut_off, more):
    """Peaks of one cell, or two: each grid finds another approach, and few cells hold the bodies apart."""
    n = 128
    grid = Grid(n, n, 1 / n, 1 / n)
    height = 1e-3 * np.random.default_rng(5).normal(size=grid.shape)
    if cut_off:
        surface = SelfAffineSurface(0.8, 1 / 8, cut_off / n, (1.0, 1.0), 3, rms_slope=0.1)
        height = surface.height(grid.x(), grid.y())
    problem = ContactProblem(grid, MATERIAL, height.max() - height, periodic=True)
    with ContactSolver(problem) as solver:
        by_load = [solver.solve(mean_pressure=p * MATERIAL.contact_modulus) for p in (1e-4, 3e-4, 1e-3)]
        by_approach = [solver.solve(approach=found.approach) for found in by_load]
    assert all(found.converged and not found.fallbacks for found in by_load + by_approach)
    taken, there = (sum(f.operator_applications for f in found) for found in (by_load, by_approach))
    assert taken <= there + more
    assert there <= 37


PLATEAUS = {
    "two heights": lambda rng, n: rng.integers(0, 2, (n, n)),
    "blocks": lambda rng, n: np.kron(rng.random((n // 3 + 1, n // 3 + 1)) < 0.5, np.ones((3, 3)))[:n, :n],
    "pits": lambda rng, n: np.maximum(rng.normal(size=(n, n)), 0.0),
    "peaks": lambda rng, n: rng.random((n, n)) ** 4,
}


@pytest.mark.parametrize("kind", PLATEAUS)
@pytest.mark.parametrize("n", [64, 128])
def test_a_prediction_that_is_too_bold_does_no_harm(kind, n):
    gap = 1e-3 * PLATEAUS[kind](np.random.default_rng(1), n)
    grid = Grid(n, n, 1 / n, 1 / n)
    with ContactSolver(ContactProblem(grid, MATERIAL, gap, periodic=True)) as solver:
        for pressure in (1e-6, 1e-5, 1e-4, 1e-3):
            found = solver.solve(mean_pressure=pressure * MATERIAL.contact_modulus)
            assert found.converged and found.fallbacks == 0 and found.operator_applications < 19
