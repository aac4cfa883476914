"""Stiffness, conductance and sensitivities: derivatives, known values and limits."""

from dataclasses import replace

import numpy as np
import pytest
from cases import hertz, periodic_rough

from app import (
    ContactProblem,
    ContactSolver,
    FlatPunch,
    Grid,
    InputError,
    Material,
    Sphere,
    refine,
    solve,
    solve_many,
)
from app.halfspace.influence import dense_matrix


def test_stiffness_is_the_derivative_of_the_load():
    with ContactSolver(hertz(128)) as solver:
        here = solver.solve(load=80000.0)
        stiffness, step = solver.stiffness(here), 800.0
        low, high = (solver.solve(load=80000.0 + sign * step) for sign in (-1, 1))
        assert solver.stiffness(solver.solve(approach=-1.0)) == 0
    assert stiffness == pytest.approx(2 * step / (high.approach - low.approach), rel=3e-3)
    assert stiffness == pytest.approx(hertz(128).reference(here.approach).stiffness, rel=5e-3)


@pytest.mark.parametrize("method", [None, "norm", "fmg_v11"])
def test_stiffness_where_contact_does_not_change_is_load_over_approach(method):
    grid = Grid.from_domain(24, 16, (0.0, 3.0, 0.0, 2.0))
    flat = ContactProblem(grid, Material.from_contact_modulus(1000.0), np.zeros(grid.shape))
    with ContactSolver(flat, method, {"lcp_rtol": 1e-9}) as solver:
        solution = solver.solve(approach=0.01)
        assert solver.stiffness(solution) == pytest.approx(solution.load / 0.01, rel=1e-7)


def test_stiffness_of_full_contact_is_infinite():
    grid = Grid.from_domain(16, 16, (0.0, 1.0, 0.0, 1.0))
    wave = 1e-4 * np.cos(2 * np.pi * grid.x()) + np.zeros(grid.shape)
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1000.0), wave, True)) as solver:
        assert solver.stiffness(solver.solve(mean_pressure=100.0)) == np.inf
        half = solver.solve(mean_pressure=0.1)
        low, high = (solver.solve(mean_pressure=p) for p in (0.099, 0.101))
        assert solver.stiffness(half) == pytest.approx(0.002 / (high.approach - low.approach), rel=0.3)


def disc(n, side, radius, periodic=""):
    """Return the solution, with conductance, of a flat punch on a square patch."""
    grid = Grid.from_domain(n, n, (-side / 2, side / 2, -side / 2, side / 2), periodic)
    material = Material.from_contact_modulus(1e5).conducting((2e-8, 5e-8), (400.0, np.inf))
    with ContactSolver(ContactProblem(grid, material, FlatPunch(2 * radius))) as solver:
        return solver.with_stiffness(solver.solve(load=10.0))


def test_conductance_of_a_circle_is_holms():
    solution = disc(256, 0.25, 0.1)
    assert solution.unloading_stiffness == solution.stiffness
    assert solution.conductance_width == pytest.approx(0.2, rel=0.01)
    assert solution.electrical_conductance == pytest.approx(4 * 0.1e-3 / (2e-8 + 5e-8), rel=0.01)
    assert solution.thermal_conductance == pytest.approx(4 * 0.1e-3 * 400, rel=0.01)
    names = "unloading_stiffness", "conductance_width", "electrical_conductance", "thermal_conductance"
    assert all(solution.attributes[name] == getattr(solution, name) for name in names)


def test_conductance_of_a_periodic_patch_excludes_the_bulk():
    """The sums of 1/r and 1/r^3 over a square lattice give the effect of the other discs."""
    radius, side = 0.1, 1.0
    one, many = (disc(128, side, radius, periodic).conductance_width for periodic in ("", "love"))
    effect = -3.900265 / (np.pi * side) + 9.033622 * radius**2 / (3 * np.pi * side**3)
    assert 1 / many - 1 / one == pytest.approx(effect, rel=1e-3)


@pytest.mark.parametrize("constants", [{"resistivity": 2e-8}, {"thermal_conductivity": 50.0}])
def test_constants_of_the_material_give_the_conductance_of_every_solution(constants):
    """A conductance that is asked for by a constant is never None."""
    material = Material.isotropic(2e5, 0.3).conducting(**constants)
    ball = ContactProblem(Grid.from_domain(32, 32, (-0.4, 0.4, -0.4, 0.4)), material, Sphere(10))
    name = "electrical_conductance" if "resistivity" in constants else "thermal_conductance"
    with ContactSolver(ball) as solver:
        ways = [solver.solve(load=10), *solver.path(load=[10])]
        wanted = getattr(solver.with_stiffness(replace(ways[0], stiffness=None)), name)
    ways += [solve(ball, load=10), refine(ball, load=10, until=0.5).solution]
    assert float(solve_many([ball], [10])[name][0]) == pytest.approx(wanted, rel=1e-6)
    assert all(getattr(solution, name) == pytest.approx(wanted, rel=0.05) for solution in ways)
    assert all("with_stiffness" not in repr(solution) for solution in ways)


def test_material_without_constants_has_no_electrical_conductance():
    with ContactSolver(hertz(32)) as solver:
        solution = solver.with_stiffness(solver.solve(load=8e4))
        nothing = solver.with_stiffness(solver.solve(approach=-1.0))
    assert solution.electrical_conductance is solution.thermal_conductance is None
    assert solution.conductance_width == solution.stiffness / solution.problem["contact_modulus"]
    assert nothing.unloading_stiffness == nothing.conductance_width == 0


@pytest.mark.parametrize(
    ("problem", "loading"),
    [(hertz(24), {"load": 8e4}), (periodic_rough(32), {"approach": -5e-3}), (periodic_rough(32), {"mean_gap": 5e-3})],
    ids=["load", "approach", "mean_gap"],
)  # fmt: skip
def test_moving_the_whole_shape_moves_the_approach_or_the_load(problem, loading):
    with ContactSolver(problem) as solver:
        solution = solver.solve(**loading)
        load, approach, total = (
            solver.sensitivity(solution, of) for of in ("load", "approach", np.ones(solution.grid.shape))
        )
        stiffness = solver.stiffness(solution)
    assert load.sum() == pytest.approx(-stiffness, rel=1e-7)
    assert approach.sum() == pytest.approx(1, rel=1e-12)
    assert not load[~solution.contact].any() and not approach[~solution.contact].any()
    change = -stiffness / solution.grid.cell_area if solution.prescribed == "approach" else 0
    assert total.sum() == pytest.approx(change, abs=1e-7 * stiffness / solution.grid.cell_area)
    if solution.prescribed == "load":
        np.testing.assert_allclose(total, 0, atol=1e-7 * abs(load).max() / solution.grid.cell_area)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.3])
def test_plastic_cells_count_when_the_contact_unloads(share):
    """Stiffnesses against finite differences: with the hardness, and of the indented shape without it."""
    grid = Grid.from_domain(40, 40, (-1.0, 1.0, -1.0, 1.0))
    shape = (grid.x() ** 2 + 1.3 * grid.y()[:, None] ** 2) / 4
    material, options = Material.from_contact_modulus(1.0), {"lcp_rtol": 1e-12, "lcp_precision": "double"}

    def slope(solver, here, step):
        contact, low = here.contact, solver.solve(approach=here.approach - step)
        assert (low.contact == contact).all()
        return (here.load - low.load) / step

    elastic = ContactProblem(grid, material, shape)
    highest = solve(elastic, load=0.2).max_pressure
    with ContactSolver(replace(elastic, hardness=share * highest), options=options) as solver:
        loaded = solver.with_stiffness(solver.solve(load=0.2))
        assert loaded.stiffness == pytest.approx(slope(solver, loaded, 1e-7), rel=1e-4)
        assert solver.stiffness(loaded) == loaded.stiffness
    with ContactSolver(
        ContactProblem(grid, material, shape + loaded.plastic_depth), options=options
    ) as solver:
        again = solver.solve(approach=loaded.approach)
        assert loaded.unloading_stiffness == pytest.approx(slope(solver, again, 1e-8), rel=1e-3)
        assert solver.stiffness(again) == pytest.approx(loaded.unloading_stiffness, rel=1e-7)
    assert loaded.stiffness < loaded.unloading_stiffness == loaded.conductance_width


@pytest.mark.parametrize(("hardness", "unloading"), [(np.inf, 1.56), (0.45, 1.56), (0.3, 1.61), (0.2, 1.76)])
def test_stiffnesses_of_a_sphere_are_those_of_dense_systems(hardness, unloading):
    grid = Grid.from_domain(40, 40, (-1.0, 1.0, -1.0, 1.0))
    shape = (grid.x() ** 2 + grid.y()[:, None] ** 2) / 2
    problem = ContactProblem(grid, Material.from_contact_modulus(1.0), shape, hardness=hardness)
    with ContactSolver(problem) as solver:
        solution = solver.with_stiffness(solver.solve(approach=0.605))

    def stiffness_of(cells):
        matrix = dense_matrix(grid, problem.material.kernel)[np.ix_(*2 * [np.flatnonzero(cells)])]
        return grid.cell_area * np.linalg.solve(matrix, np.ones(len(matrix))).sum()

    elastic = solution.contact & (solution.pressure < hardness)
    assert solution.stiffness == pytest.approx(stiffness_of(elastic), rel=1e-7)
    assert solution.unloading_stiffness == pytest.approx(stiffness_of(solution.contact), rel=1e-7)
    assert solution.unloading_stiffness == pytest.approx(unloading, rel=0.01)


def test_without_elastic_contact_the_load_is_constant():
    problem = replace(hertz(16), hardness=10.0)
    with ContactSolver(problem) as solver:
        solution = solver.with_stiffness(solver.solve(approach=0.5))
        assert solution.plastic.sum() == solution.contact_cells
        assert solution.stiffness == 0 < solution.unloading_stiffness
        assert not solver.sensitivity(solution).any()
        with pytest.raises(InputError, match="no elastic contact"):
            solver.sensitivity(solution, "approach")


def test_sensitivities_in_full_contact():
    grid = Grid.from_domain(12, 16, (0.0, 1.0, 0.0, 1.0))
    rng = np.random.default_rng(1)
    wave, change, g = 1e-4 * np.cos(2 * np.pi * grid.x()) + np.zeros(grid.shape), *rng.random((2, 16, 12))

    def problem(shape):
        return ContactProblem(grid, Material.from_contact_modulus(1000.0), shape, True)

    with ContactSolver(problem(wave)) as solver:
        full = solver.solve(mean_pressure=100.0)
        by_load, approach = solver.sensitivity(full, g), solver.sensitivity(full, "approach")
        for of in ("load", g):
            with pytest.raises(InputError, match="no derivatives at a fixed approach"):
                solver.sensitivity(solver.solve(approach=full.approach), of)
        solver.update(problem(wave + 1e-4 * change))
        moved = solver.solve(mean_pressure=100.0)
    assert full.contact.all() and moved.contact.all()
    expected = np.vdot(g, moved.pressure - full.pressure)
    assert 1e-4 * np.vdot(by_load, change) == pytest.approx(expected, rel=1e-7)
    assert 1e-4 * np.vdot(approach, change) == pytest.approx(moved.approach - full.approach, rel=1e-7)


def test_sensitivities_without_contact():
    with ContactSolver(hertz(16)) as solver:
        open_ = solver.solve(approach=-1.0)
        assert not solver.sensitivity(open_).any() and not solver.sensitivity(open_, np.ones((16, 16))).any()
        with pytest.raises(InputError, match="no elastic contact"):
            solver.sensitivity(open_, "approach")


@pytest.mark.parametrize(
    ("of", "message"),
    [
        ("area", "'area': must be 'load', 'approach' or an array"),
        (np.ones((3, 4)), r"has shape \(3, 4\); must be \(16, 16\)"),
        (np.full((16, 16), np.nan), "must be finite in contact"),
        (None, "must be an array"),
        (1j * np.ones((16, 16)), "must be an array"),
    ],
)
def test_wrong_numbers_have_no_sensitivity(of, message):
    with ContactSolver(hertz(16)) as solver:
        solution = solver.solve(load=8e4)
        with pytest.raises(InputError, match=f"^sensitivity: of.*{message}"):
            solver.sensitivity(solution, of)
