"""A load with its centre: how load and moments are met, also where the iteration fails."""

import warnings

import pytest

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface, Sphere
from app.base.errors import InputError
from app.contact.prescribed_load import PrescribedLoad
from app.contact.state import Displacement
from app.contact.tilted_load import TiltedLoad

STEEL = Material.isotropic(210e3, 0.3)


def test_meeting_gives_load_and_moments_exactly():
    grid = Grid.from_domain(24, 20, (-1, 1, -1, 1))
    with ContactSolver(ContactProblem(grid, STEEL, Sphere(10))) as solver:
        solution = solver.solve(load=100)
        state = solver._strategy._started_from(solution, PrescribedLoad(100.0))
        loading = TiltedLoad(130.0, 1.0, (0.05, -0.02), 1.0)
        loading.meet(state)
        p = state.p
        assert state.displacement_status is Displacement.STALE
        assert (p >= 0).all() and not p[~state.contact].any()
        total = p.sum()
        assert grid.cell_area * total == pytest.approx(130, rel=1e-11)
        assert (p * grid.x()).sum() / total == pytest.approx(0.05, rel=1e-9)
        assert (p * grid.y()[:, None]).sum() / total == pytest.approx(-0.02, rel=1e-9)
        assert loading.moment_error(state) < 1e-11
        state.destroy()


def test_a_body_on_three_asperities_is_balanced():
    """Few cells carry a light load; most of these solves need the safeguard."""
    grid = Grid.from_domain(48, 46, (-1, 1, -0.8, 0.8))
    surface = SelfAffineSurface(0.8, 0.5, 0.1, (2.0, 1.6), 2, rms_slope=0.02)
    body = ContactProblem(grid, STEEL, lambda x, y: (x**2 + y**2 / 2) / 20, surfaces=[surface])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with ContactSolver(body) as solver:
            solution = solver.solve(load=3.0, load_centre=(0.2, -0.1))
    assert solution.converged and solution.contact_cells < 20
    assert solution.pressure_centre_x == pytest.approx(0.2, abs=1e-9)
    assert solution.pressure_centre_y == pytest.approx(-0.1, abs=1e-9)


def test_moments_take_little_more_than_a_load():
    grid = Grid.from_domain(256, 256, (-1, 1, -1, 1))
    with ContactSolver(ContactProblem(grid, STEEL, Sphere(20))) as solver:
        plain = solver.solve(load=700)
        for centre in ((0.0, 0.0), (0.25, 0.1)):
            tilted = solver.solve(load=700, load_centre=centre)
            assert tilted.fallbacks == 0
            assert tilted.operator_applications < 1.5 * plain.operator_applications


def test_a_load_that_no_pressure_balances_is_refused():
    """The centre is inside the convex hull, but cells at their hardness do not carry the load there."""
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem = ContactProblem(grid, STEEL, Sphere(10), hardness=300.0)
        refusal = pytest.raises(InputError, match="must be less than 477 N")
        with ContactSolver(problem) as solver, refusal:
            solver.solve(load=600, load_centre=(0.6, 0.0))


def test_a_start_on_an_elongated_patch_saves_work():
    """Coarse cells there are longer in one direction, which the stiffness of the start must allow for."""
    grid = Grid(2048, 8, 1.0, 1.0, -1023.5, -3.5)
    gap = 1e-6 * grid.x() ** 2 + 1e-3 * grid.y()[:, None] ** 2
    with ContactSolver(ContactProblem(grid, Material.combined(1.0, 0.3), gap)) as solver:
        first = solver.solve(load=30.0, load_centre=(0, 0))
        afresh = solver.solve(load=30.1, load_centre=(0, 0.05))
        again = solver.solve(load=30.1, load_centre=(0, 0.05), start=first)
    assert again.tilt_y == pytest.approx(afresh.tilt_y, rel=1e-4)
    assert again.operator_applications < 3 * afresh.operator_applications
