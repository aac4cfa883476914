"""Coatings and layers on periodic patches, against theory, dense solutions and the limits."""

from dataclasses import replace

import numpy as np
import pytest
from cases import periodic_rough
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, solve
from app.api.subsurface import stress
from app.contact.certificate import certify
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.contact.state import Displacement
from app.halfspace.operator import InfluenceOperator
from app.verification.dense import DenseProblem
from app.verification.solving import difference, random_problem

RADIUS = 10.0


def on_layer(nu, contact_radius, relative_thickness, n=128, young=3.0):
    """A sphere that thin-layer theory presses on a layer to a contact radius, and the theory's load."""
    thickness = relative_thickness * contact_radius
    problem = ContactProblem(
        Grid.from_domain(n, n, (-1, 1, -1, 1)),
        Material.layer(young, nu, thickness),
        Sphere(RADIUS),
        periodic=True,
    )
    if nu == 0.5:
        approach = contact_radius**2 / (4 * RADIUS)
        return problem, approach, 2 * np.pi / 3 * young * RADIUS**2 * approach**3 / thickness**3
    modulus = young * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    approach = contact_radius**2 / (2 * RADIUS)
    return problem, approach, np.pi * modulus * RADIUS * approach**2 / thickness


def test_thin_incompressible_layer_obeys_lubrication_theory():
    errors = []
    for relative_thickness in (0.108, 0.054):
        problem, approach, load = on_layer(0.5, 0.7, relative_thickness)
        solution = solve(problem, approach=approach)
        errors.append(solution.load / load - 1)
    assert errors[1] < 0.06
    assert errors[0] > 3 * errors[1]


@pytest.mark.parametrize("periodic", ["spectral", "love"])
@pytest.mark.parametrize("thickness", [0.01, 0.1, 1.0, 30.0])
@pytest.mark.parametrize("moduli", [(10.0, 1.0), (1.0, 10.0), (1.0, np.inf)])
def test_full_contact_of_a_wave(periodic, thickness, moduli):
    grid = Grid.from_domain(24, 20, (0, 1, 0, 1.5), periodic)
    x, y = np.meshgrid(grid.x(), grid.y())
    wave = 1e-3 * np.cos(2 * np.pi * (2 * x + y / 1.5))
    material = Material.coated(moduli, (0.4, 0.3), thickness, other=(5.0, 0.1))
    eigenvalue = material.kernel.eigenvalues(grid, np.array([2]), np.array([1]))[0, 0]
    solution = solve(ContactProblem(grid, material, wave + 0.01), mean_pressure=1.0)
    np.testing.assert_allclose(solution.pressure, 1 - wave / eigenvalue, rtol=1e-12)
    mean_gap = 0.01 - solution.approach + material.kernel.uniform_compliance(grid) * 1.0
    assert mean_gap == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("method", [None, "fmg_v11"])
def test_all_loadings_lead_to_the_same_solution(method):
    problem, approach, _ = on_layer(0.3, 0.6, 0.2, 48)
    with ContactSolver(problem, method, {"lcp_rtol": 1e-7}) as solver:
        first = solver.solve(load=1.0)
        for loading in ("approach", "mean_pressure", "mean_gap"):
            other = solver.solve(**{loading: getattr(first, loading)})
            assert other.converged and other.prescribed.startswith(loading.replace("mean_pressure", "load"))
            assert other.load == pytest.approx(1, rel=1e-4)
            assert other.approach == pytest.approx(first.approach, rel=1e-5)
            assert abs(other.gap - first.gap).max() < 1e-4 * first.approach
        again = solver.solve(load=1.1, start=first)
        assert again.approach == pytest.approx(solver.solve(load=1.1).approach, rel=1e-5)


def test_approach_beyond_full_contact_compresses_a_layer():
    problem, *_ = on_layer(0.3, 0.6, 0.2, 24)
    shape = problem.shape_on(problem.grid)
    solution = solve(problem, approach=0.5)
    assert solution.contact.all()
    expected = (0.5 - shape.mean()) / problem.material.kernel.uniform_compliance(problem.grid)
    assert solution.mean_pressure == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("poisson", [0.3, 0.499, 0.4999999])
@pytest.mark.parametrize("lowest", [1e-7, 1e-2])
def test_approaches_need_few_solves(poisson, lowest):
    rng = np.random.default_rng(1)
    gap = rng.uniform(0.1, 1.0, (8, 48))
    gap[2, 5] = 0.0
    problem = ContactProblem(Grid(48, 8, 1.0, 1.0, periodic=True), Material.layer(1.0, poisson, 0.4), gap)
    compliance = problem.kernel.uniform_compliance(problem.grid)
    with ContactSolver(problem) as solver:
        for approach in (lowest, 0.1, 0.3, 0.5, 0.6, 2.0):
            solution = solver.solve(approach=approach)
            assert solution.converged
            assert solution.operator_applications < 200
            assert solution.approach == approach
            depth = approach - compliance * solution.mean_pressure
            other = DenseProblem(problem).under(solution.load, depth)[1]
            assert other == pytest.approx(depth, rel=1e-3)


def test_stiffness_includes_the_uniform_compression():
    problem, approach, _ = on_layer(0.3, 0.6, 0.2, 32)
    with ContactSolver(problem, None, {"lcp_rtol": 1e-8}) as solver:
        solution = solver.with_stiffness(solver.solve(approach=approach))
        step = 1e-4 * approach
        low, high = (solver.solve(approach=approach + s).load for s in (-step, step))
    assert solution.conductance_width is None
    assert solution.stiffness == pytest.approx((high - low) / (2 * step), rel=0.05)  # cells enter contact


@pytest.mark.parametrize("approach, in_contact", [(0.01, 0.1), (0.03, 0.3), (0.5, 1.0)])
@pytest.mark.parametrize("other", [None, (3.0, 0.2)])
def test_sensitivities_at_a_fixed_approach_include_the_uniform_compression(approach, in_contact, other):
    """Against differences of two solutions with the same contact cells."""
    grid = Grid.from_domain(12, 10, (-1, 1, -0.9, 0.9), "spectral")
    x, y = np.meshgrid(grid.x(), grid.y())
    gap, rng = (x**2 + y**2) / 20, np.random.default_rng(3)
    change, weights = rng.uniform(-1, 1, (2, *grid.shape))
    material, options = (
        Material.layer(1.0, 0.3, 0.4, other=other),
        {"lcp_rtol": 1e-12, "lcp_precision": "double"},
    )
    problem, step = ContactProblem(grid, material, gap), 1e-5
    with ContactSolver(problem, None, options) as solver:
        solution = solver.solve(approach=approach)
        assert solution.contact.mean() >= in_contact
        found = [(solver.sensitivity(solution, of) * change).sum() for of in ("load", weights)]
        low, high = (
            (solver.update(replace(problem, gap=gap + s * change)), solver.solve(approach=approach))[1]
            for s in (-step, step)
        )
    assert (low.contact == high.contact).all()
    expected = high.load - low.load, (weights * (high.pressure - low.pressure)).sum()
    np.testing.assert_allclose(found, np.array(expected) / (2 * step), rtol=1e-4)


@pytest.mark.parametrize("nu, cells", [(0.3, 1), (0.49, 1), (0.5, 1), (0.5, 4)])
def test_rough_contact_of_thin_layers_is_solved(nu, cells):
    n = 64
    rough = periodic_rough(n)
    problem = ContactProblem(rough.grid, Material.layer(1.0, nu, cells / n), surfaces=rough.surfaces)
    with ContactSolver(problem) as solver:
        for pressure in (0.01, 1.0):
            solution = solver.solve(mean_pressure=pressure)
            assert solution.converged and not solution.fallbacks


@pytest.mark.mpi(2)
def test_ranks_agree_on_layers(comm):
    rough = periodic_rough(64)
    for moduli, nu in (((10.0, 1.0), 0.3), ((1.0, np.inf), 0.5)):
        material = Material.coated(moduli, (nu, 0.3), 1 / 64)
        problem = ContactProblem(rough.grid, material, surfaces=rough.surfaces)
        here, alone = (solve(problem, mean_pressure=0.1, comm=ranks) for ranks in (comm, MPI.COMM_SELF))
        assert (here.contact == alone.contact[here.slabs.rows]).all()
        assert here.approach == pytest.approx(alone.approach, rel=1e-6)


def test_what_layers_do_not_allow_is_refused():
    grid, layer = Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.layer(1.0, 0.3, 0.1)
    for nu, thickness, text in (
        (0.3, 1e-4, "must be at least 0.002 mm"),
        (0.5, 0.03, "3 times its thickness"),
    ):
        with pytest.raises(InputError, match=text):
            ContactSolver(ContactProblem(grid, Material.layer(1, nu, thickness), Sphere(10), periodic="love"))
    with ContactSolver(ContactProblem(grid, layer, Sphere(10), periodic=True)) as solver:
        solution = solver.solve(load=0.1)
        for wrong, text in (
            ({"body": 2}, "body 2: is rigid"),
            ({"poisson_ratio": 0.3}, "no effect with a coating"),
        ):
            with pytest.raises(InputError, match=text):
                stress(solution, **wrong)
        with pytest.raises(InputError, match="at most the thickness 0.1 mm"):
            stress(solution).plane(0.2)
    hard = ContactProblem(grid, layer, Sphere(10), periodic=True, hardness=1.0)
    with pytest.raises(InputError, match="not with a hardness for a layer on a rigid base"):
        solve(hard, approach=0.01)
    assert solve(hard, load=0.1).converged


@pytest.mark.parametrize("method", [None, "fmg_v11", "norm"])
@pytest.mark.parametrize(
    "material",
    [
        Material.coated((0.5, 5.0), (0.3, 0.3), 0.1),
        Material.coated((20.0, 5.0), (0.3, 0.3), 0.05, other=(9.0, 0.2)),
        Material.layer(1.0, 0.3, 0.1),
        Material.layer(1.0, 0.5, 0.3),
    ],
)
def test_free_patches_equal_a_dense_solution(material, method):
    grid = Grid.from_domain(16, 12, (-1, 1, -0.8, 0.8))
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = (x**2 + 2 * y**2) / 20 + 0.004 * np.cos(9 * x) * np.cos(7 * y)
    problem = ContactProblem(grid, material, gap)
    expected = DenseProblem(problem).at(0.02).astype(float)
    solution = solve(
        problem, approach=0.02, method=method, options={"lcp_rtol": 1e-8, "lcp_precision": "double"}
    )
    assert solution.converged
    assert difference(solution.pressure, expected) < 1e-5
    again = solve(problem, load=solution.load, method=method)
    assert again.approach == pytest.approx(0.02, rel=1e-4)


def test_thin_compressible_layer_on_a_free_patch_is_a_bed_of_springs():
    thickness, radius, approach = 0.05, 20.0, 0.025
    material = Material.layer(3.0, 0.3, thickness)
    grid = Grid.from_domain(256, 256, (-1.2, 1.2, -1.2, 1.2))
    solution = solve(ContactProblem(grid, material, Sphere(radius)), approach=approach)
    modulus = thickness / material.kernel.layers[0].uniform_compliance
    assert solution.load == pytest.approx(np.pi * modulus * radius * approach**2 / thickness, rel=2e-3)
    assert np.sqrt(solution.contact_area / np.pi) == pytest.approx(np.sqrt(2 * radius * approach), rel=1e-2)


@pytest.mark.parametrize("moduli, nu", [((10.0, 1.0), 0.3), ((1.0, np.inf), 0.3), ((1.0, np.inf), 0.5)])
@pytest.mark.parametrize("periodic", ["spectral", "love"])
def test_certificate_bounds_the_error_of_any_pressure(moduli, nu, periodic):
    rng = np.random.default_rng(5)
    for _ in range(4):
        problem = random_problem(rng, 12, 10, periodic, holes=False)
        problem = ContactProblem(problem.grid, Material.coated(moduli, (nu, 0.3), 0.3), problem.gap)
        dense = DenseProblem(problem)
        approach = 0.3 * problem.gap.min() + 0.7 * problem.gap.mean()
        exact = dense.at(approach).astype(float)
        operator = InfluenceOperator(problem.grid, problem.material.kernel)
        state = contact_state(operator, UndeformedDistance(operator, problem.gap))
        state.approach = approach
        for size in (0.0, 1e-12, 1e-6, 1e-3, 0.1, 1.0):
            p = np.maximum(exact + size * exact.max() * rng.normal(size=exact.shape), 0)
            state.values[...], state.displacement_status = p, Displacement.STALE
            error = np.sqrt(max((p - exact).ravel() @ dense.matrix @ (p - exact).ravel(), 0.0))
            assert error <= certify(state).error_bound * np.sqrt(p.ravel() @ dense.matrix @ p.ravel()) * (
                1 + 1e-9
            )


@pytest.mark.parametrize(
    "young, nu, most",
    [((1.0, 2.0), 0.3, 40), ((2.0, 1.0), 0.3, 45), ((1.0, np.inf), 0.3, 25), ((1.0, np.inf), 0.45, 25)],
)
@pytest.mark.parametrize("cells", [1, 10])
def test_work_on_free_patches_is_bounded(young, nu, most, cells):
    rough, grid = periodic_rough(64), Grid.from_domain(64, 64, (0, 1, 0, 1))
    material = Material.coated(young, (nu, 0.3), cells / 64)
    solution = solve(ContactProblem(grid, material, surfaces=rough.surfaces), load=0.02)
    assert solution.converged
    assert not solution.fallbacks
    assert solution.operator_applications < most


@pytest.mark.parametrize("young, cells", [(0.2, 1), (0.5, 10), (2.0, 1), (2.0, 10), (2.0, 100), (5.0, 10)])
def test_work_on_large_free_patches_is_that_of_half_spaces(young, cells):
    """At most 1.5 times as many products."""
    rough, grid = periodic_rough(128), Grid.from_domain(128, 128, (0, 1, 0, 1))
    counts = []
    for material in (
        Material.pair((1.0, np.inf), (0.3, 0)),
        Material.coated((young, 1.0), (0.3, 0.3), cells / 128),
    ):
        with ContactSolver(ContactProblem(grid, material, surfaces=rough.surfaces)) as solver:
            modulus = 1 / material.kernel.compliance_at(0.25)  # of the longest waves of the surface
            solutions = [solver.solve(load=share * modulus) for share in (0.003, 0.03)]
        assert all(solution.converged and not solution.fallbacks for solution in solutions)
        counts.append(sum(solution.operator_applications for solution in solutions))
    assert counts[1] < 1.5 * counts[0]


@pytest.mark.parametrize("young", [(0.2, 1.0), (0.5, 1.0), (2.0, 1.0), (1.0, np.inf)])
@pytest.mark.parametrize("cells", [1, 3, 30])
def test_work_on_periodic_patches_is_that_of_half_spaces(young, cells):
    """At most 1.5 times as many products, and two more."""
    rough = periodic_rough(64)
    counts = []
    for material in (Material.pair((1.0, np.inf), (0.3, 0)), Material.coated(young, (0.3, 0.3), cells / 64)):
        problem = ContactProblem(rough.grid, material, surfaces=rough.surfaces)
        with ContactSolver(problem) as solver:
            modulus = 1 / material.kernel.compliance_at(0.25)  # of the longest waves of the surface
            solutions = [solver.solve(mean_pressure=share * modulus) for share in (0.003, 0.03)]
        assert all(solution.converged and not solution.fallbacks for solution in solutions)
        counts.append(sum(solution.operator_applications for solution in solutions))
    assert counts[1] < 1.5 * counts[0] + 4
