"""Viscoelastic bodies: each time step obeys the contact conditions with the hereditary integral, and known limits."""

import histories
import numpy as np
import pytest
from scipy.integrate import quad

from app import ContactProblem, ContactSolver, Grid, InputError, Material, NoteWarning, Sphere
from app.base.mpi import MPI
from app.contact.loading_input import LOADINGS
from app.contact.prescribed_load import PrescribedLoad
from app.halfspace.creep import CreepFunction
from app.verification.dense import DenseProblem

pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")
RUBBER = Material.pair((10, np.inf), (0.5, 0.3))
MAXWELL = RUBBER.viscoelastic(1.0, 0.6)
SPECTRUM = RUBBER.viscoelastic((0.1, 1.0, 30.0), (0.2, 0.3, 0.1))
assert NoteWarning


def hereditary(matrix, creep, times, pressures, step):
    """Return u at a time, by the integral of J over pressures that change linearly."""
    t, u = times[step], matrix @ pressures[0] * creep.at(times[step] - times[0])
    for k in range(step):
        rate = matrix @ (pressures[k + 1] - pressures[k]) / (times[k + 1] - times[k])
        u += rate * quad(lambda s: creep.at(t - s), times[k], times[k + 1], epsabs=1e-12)[0]
    return u


@pytest.mark.parametrize("periodic", [None, True, "y"])
@pytest.mark.parametrize("kind", ["load", "approach"])
def test_steps_obey_the_contact_conditions(kind, periodic):
    rng = np.random.default_rng(4)
    grid = Grid.from_domain(9, 8, (-1, 1, -1, 1))
    problem = ContactProblem(grid, SPECTRUM, 0.1 * rng.random(grid.shape), periodic=periodic)
    times = [0.0, 0.05, 0.3, 2.0, 50.0, 51.0]
    numbers = [0.5, 1.0, 1.5, 1.2, 0.6, 0.0] if kind == "load" else [0.01, 0.03, 0.04, 0.05, 0.03, 0.02]
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        path = solver.creep(times, **{kind: numbers})
        solutions = list(path)
    dense = DenseProblem(problem)
    pressures = [solution.pressure.ravel() for solution in solutions]
    for step, solution in enumerate(solutions):
        u = hereditary(dense.matrix, SPECTRUM.creep, times, pressures, step)
        e = problem.gap.ravel() - solution.approach + u
        assert solution.converged and path.table["time"][step] == solution.time == times[step]
        np.testing.assert_allclose(solution.displacement.ravel(), u, atol=1e-9)
        np.testing.assert_allclose(solution.gap.ravel(), e, atol=1e-9)
        assert (
            e.min() > -1e-8
            and pressures[step].min() >= 0
            and abs(e[pressures[step] > 0]).max(initial=0) < 1e-8
        )
        total = pressures[step].sum() * grid.cell_area
        assert (solution.load, getattr(solution, kind)) == pytest.approx((total, numbers[step]), abs=1e-9)
        assert solution.max_pressure == pytest.approx(pressures[step].max())


def test_creep_function_is_the_inverse_of_the_relaxation():
    """The convolution of relaxation and creep is 1, by their Laplace transforms."""
    times, moduli = np.array([0.1, 1.0, 1.0, 30.0]), np.array([0.2, 0.1, 0.2, 0.3])
    creep = CreepFunction.from_relaxation(times, moduli)
    for s in np.geomspace(1e-4, 1e3, 30):
        relaxation = 1 - (moduli / (1 + s * times)).sum()
        compliance = 1 + (np.array(creep.strengths) / (1 + s * np.array(creep.times))).sum()
        assert relaxation * compliance == pytest.approx(1, rel=1e-12)
    assert creep.at(0) == 1 and creep.at(1e9) == pytest.approx(1 / (1 - moduli.sum()))
    between = np.sort(np.unique(times))
    assert all(
        a < tau < b for a, tau, b in zip(between, sorted(creep.times), [*between[1:], np.inf], strict=True)
    )


@pytest.mark.parametrize("modulus", [1e-17, 1e-30, 1e-300])
@pytest.mark.parametrize("time", [0.3, 3.0, 7.0, 49.0])
def test_terms_below_rounding_and_equal_times_change_nothing(time, modulus):
    plain = CreepFunction.from_relaxation([1.0], [0.4]).at(np.array([0.5, 100.0]))
    tiny = CreepFunction.from_relaxation([time, 1.0], [modulus, 0.4])
    twice = CreepFunction.from_relaxation([1.0 + 1e-15, 1.0], [0.3, 0.1])
    for each in tiny, twice:
        np.testing.assert_allclose(each.at(np.array([0.5, 100.0])), plain, rtol=1e-12)
    assert CreepFunction.from_relaxation([time], [modulus]).at(1e3 * time) == 1


@pytest.mark.parametrize("rest", [1e-3, 1e-8, 1e-12, 2.0**-53])
def test_steps_of_nearly_fluid_bodies_follow_the_creep_function(rest):
    """A constant pressure displaces by J of the duration, one that grows from 0 by the mean of J."""
    creep = CreepFunction.from_relaxation([1.0], [1 - rest])
    strengths = np.array(creep.strengths)
    for duration in (1e-6, 0.1, 3.0):
        decay, before, after = creep.step(duration)
        assert 1 + strengths @ (before + after) == pytest.approx(creep.at(duration), rel=1e-12)
        mean = quad(creep.at, 0, duration, epsabs=0)[0] / duration
        assert 1 + strengths @ after == pytest.approx(mean, rel=1e-12)
        np.testing.assert_allclose(decay + before + after, 1, rtol=1e-15)


@pytest.mark.parametrize("rest", [0.5, 1e-3, 1e-6, 1e-9])
def test_coefficients_of_steps_do_not_lose_digits(rest):
    """Against the relaxation's own internal state, in extended precision."""
    times, moduli = np.array([1e-3, 0.2, 1.0, 40.0]), np.array([0.2, 0.3, 0.1, 0.4]) * (1 - rest)
    creep, memory = CreepFunction.from_relaxation(times, moduli), histories.Memory(times, moduli)
    order, mine = np.argsort(memory.rates), np.argsort(creep.times)[::-1]
    np.testing.assert_allclose(np.array(creep.times)[mine] * memory.rates[order], 1, rtol=1e-10)
    rounding = np.finfo(float).eps / (1 - moduli.sum())  # of the moduli
    for duration in np.geomspace(1e-12, 1e12, 49):
        _, *expected = memory.step(duration)
        _, *found = creep.step(duration)
        for one, other in zip(found, expected, strict=True):
            strength = (memory.coupling * other)[order]
            np.testing.assert_allclose(
                (np.array(creep.strengths) * one)[mine], strength, rtol=1e-12 + 10 * rounding
            )


@pytest.mark.parametrize("kind", ["load", "mean_pressure"])
def test_a_flat_periodic_body_creeps_under_a_load(kind):
    grid = Grid.from_domain(3, 8, (0, 3, 0, 8), periodic=True)
    with ContactSolver(ContactProblem(grid, SPECTRUM, np.zeros(grid.shape))) as solver:
        for solution in solver.creep([0, 0.3, 1.7, 1.72], **{kind: [4e-4, 0.13, 0.09, 0.6]}):
            assert solution.converged and solution.contact_fraction == 1
            assert np.ptp(solution.pressure) < 1e-12 * solution.max_pressure


def test_own_loadings_that_are_loads_are_found_when_they_are_used():
    class KiloNewton(PrescribedLoad):
        name, unit, meaning = "kilonewtons", "kN", "load in kN"

        @staticmethod
        def load_per_number(grid):
            return 1000.0

    LOADINGS["kilonewtons"] = KiloNewton
    try:
        with ContactSolver(ball(MAXWELL, 32)) as solver:
            *_, own = solver.creep([0, 1], kilonewtons=3e-4)
            *_, usual = solver.creep([0, 1], load=0.3)
    finally:
        del LOADINGS["kilonewtons"]
    assert own.load == usual.load == 0.3
    np.testing.assert_allclose(own.pressure, usual.pressure, atol=1e-12 * usual.max_pressure)


def ball(material, n=64):
    return ContactProblem(Grid.from_domain(n, n, (-1.2, 1.2, -1.2, 1.2)), material, Sphere(10))


def test_ball_under_a_constant_load_of_lee_and_radok():
    """The contact area grows as J^(2/3), and the pressure is the hereditary integral over the growing contact."""
    times = np.linspace(0, 3, 25)
    with ContactSolver(ball(MAXWELL, 96)) as solver:
        *_, last = path = list(solver.creep(times, load=0.3))
    creep = MAXWELL.creep.at(times)
    radius = np.cbrt(3 * 0.3 * 10 / (4 * MAXWELL.contact_modulus) * creep)
    areas = np.array([solution.contact_fraction_corrected * solution.grid.area for solution in path])
    np.testing.assert_allclose(np.sqrt(areas / np.pi), radius, rtol=0.02)
    indentations = np.array([solution.indentation for solution in path])
    np.testing.assert_allclose(indentations, radius**2 / 10, rtol=0.01)
    r = np.hypot(last.x, last.y[:, None])
    fine = np.linspace(0, 3, 4001)
    growth = np.cbrt(3 * 0.3 * 10 / (4 * MAXWELL.contact_modulus) * MAXWELL.creep.at(fine))
    profile = np.sqrt(np.maximum(growth[:, None] ** 2 - np.linspace(0, 1, 40) ** 2 * radius[-1] ** 2, 0))
    relaxed = 1 - 0.6 * (1 - np.exp(-(3 - fine)))
    middle = (relaxed[1:] + relaxed[:-1]) / 2
    pressure = relaxed[0] * profile[0] + middle @ np.diff(profile, axis=0)
    exact = (
        2
        * MAXWELL.contact_modulus
        / (np.pi * 10)
        * np.interp(r, np.linspace(0, 1, 40) * radius[-1], pressure)
    )
    inside = r < 0.9 * radius[-1]
    np.testing.assert_allclose(last.pressure[inside], exact[inside], rtol=0.03)


def test_relaxation_at_constant_approach_converges_with_second_order():
    errors = []
    with ContactSolver(ball(MAXWELL)) as solver:
        for steps in (4, 8, 16):
            times = np.linspace(0, 2, steps + 1)
            path = solver.creep(times, approach=0.05)
            loads = np.array([solution.load for solution in path])
            errors.append(abs(loads / loads[0] - (1 - 0.6 * (1 - np.exp(-times)))).max())
    assert errors[0] < 0.01
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4, rtol=0.1)


def test_limits_are_elastic_and_a_solve_after_a_path_is_the_bodies_own():
    with ContactSolver(ball(MAXWELL)) as solver:
        first, early, late = solver.creep([0, 1e-9, 1e9], load=0.2)
        again = solver.solve(load=0.2)
    relaxed = Material.from_contact_modulus(MAXWELL.contact_modulus * 0.4)
    with ContactSolver(ball(relaxed)) as solver:
        slow = solver.solve(load=0.2)
    np.testing.assert_array_equal(first.pressure, again.pressure)
    np.testing.assert_allclose(early.pressure, first.pressure, atol=1e-5 * first.max_pressure)
    # Pressures change linearly over the long step, so the bodies remember nothing of the first one.
    np.testing.assert_allclose(late.pressure, slow.pressure, atol=1e-4 * slow.max_pressure)
    assert late.approach == pytest.approx(slow.approach, rel=1e-5)
    assert first.operator_applications == again.operator_applications
    assert early.operator_applications <= 1.1 * first.operator_applications + 1  # the product A r


def test_one_body_creeps():
    pair = Material.pair((210e3, 10), (0.3, 0.5))
    both, soft = pair.viscoelastic(1, 0.5), pair.viscoelastic(1, 0.5, body=2)
    hard = pair.viscoelastic(1, 0.5, body=1)
    share = (1 - 0.3**2) / 210e3 * pair.contact_modulus
    assert repr(soft).endswith(".viscoelastic((1,), (0.5,), body=2)")
    assert repr(pair.viscoelastic(1, 0.5, body=2.0)) == repr(soft)
    assert hard.creep.at(1e9) - 1 == pytest.approx(share * (both.creep.at(1e9) - 1))
    assert soft.creep.at(1e9) - 1 == pytest.approx((1 - share) * (both.creep.at(1e9) - 1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1, 2), (0.5,)), "one or more times"),
        (((1,), (1.0,)), "sum to less than 1"),
        (((-1,), (0.5,)), "one or more times"),
        (((5e-324,), (0.5,)), "from 1e-50 to 1e\\+50 s"),
        (("soon", 1), "must be times"),
        ((1, 0.5, 3), "body 3: must be 1 or 2"),
        ((1, 0.5, True), "body True: must be 1 or 2"),
        ((1, 0.5, 1.5), "body 1.5: must be 1 or 2"),
    ],
)
def test_wrong_spectra_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        RUBBER.viscoelastic(*arguments)


def test_a_second_relaxation_is_refused():
    with pytest.raises(InputError, match="viscoelastic already"):
        RUBBER.viscoelastic(1, 0.5, body=1).viscoelastic(2, 0.5, body=2)


def test_wrong_paths_are_refused():
    with ContactSolver(ball(MAXWELL, 16)) as solver:
        with pytest.raises(InputError, match="must increase"):
            solver.creep([0, 0], load=1)
        with pytest.raises(InputError, match="2 values of load for 3 times"):
            solver.creep([0, 1, 2], load=[1, 2])
        with pytest.raises(InputError, match="exactly one of"):
            solver.creep([0, 1])
    with (
        ContactSolver(ball(RUBBER, 16)) as solver,
        pytest.raises(InputError, match="the material is elastic"),
    ):
        solver.creep([0], load=1)
    limited = ContactProblem(Grid.from_domain(8, 8, (0, 1, 0, 1)), MAXWELL, Sphere(10), hardness=5)
    with ContactSolver(limited) as solver, pytest.raises(InputError, match="not with a hardness"):
        solver.creep([0], load=1)
    lined = ContactProblem(Grid.from_domain(8, 8, (0, 1, 0, 1)), MAXWELL, Sphere(10), surface_compliance=1)
    with ContactSolver(lined) as solver, pytest.raises(InputError, match="not with a surface compliance"):
        solver.creep([0], load=1)


def test_steps_too_short_for_floats_are_instantaneous():
    with ContactSolver(ball(MAXWELL, 16)) as solver:
        touching = solver.touching
        first, second = path = list(solver.creep([0, 5e-324], load=0.2))
        late = list(solver.creep([0, 1], load=0.2))[1]
        assert solver.touching == touching < late.approach
    assert len(path) == 2 and second.approach == pytest.approx(first.approach, rel=1e-12)


def test_rows_do_not_resume_a_path():
    with ContactSolver(ball(MAXWELL, 16)) as solver:
        path = solver.creep([0, 1, 2], load=0.2)
        next(iter(path))
        with pytest.raises(InputError, match="cannot be resumed"):
            path.resume_after(path.rows)


@pytest.mark.mpi(2, 3)
def test_ranks_agree(comm):
    problem, times = ball(SPECTRUM, 48), [0, 1, 3]
    with ContactSolver(problem, comm=comm) as solver:
        shared = [solution.gather() for solution in solver.creep(times, load=0.3)]
    if comm.rank == 0:
        with ContactSolver(problem, comm=MPI.COMM_SELF) as solver:
            for one, other in zip(shared, solver.creep(times, load=0.3), strict=True):
                np.testing.assert_allclose(one.pressure, other.pressure, atol=1e-5 * other.max_pressure)


@pytest.mark.mpi(2)
def test_other_times_on_other_ranks_are_refused(comm):
    with ContactSolver(ball(MAXWELL, 16), comm=comm) as solver, pytest.raises(InputError, match="times"):
        solver.creep([0, 1 + comm.rank], load=1)
