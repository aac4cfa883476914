"""Compliant surfaces and implicit wear."""

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, read_result
from app.base.mpi import MPI
from app.halfspace.compliant_kernel import CompliantKernel
from app.verification.dense import DenseProblem
from app.verification.solving import solved

pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")
STEEL = Material.combined(80000, 0.3)
COATED = Material.coated((4e5, 2e5), (0.2, 0.3), 0.1)
LAYER = Material.layer(5.0, 0.45, 0.2)


@pytest.mark.parametrize("periodic", [None, True, "love", "x", "y"])
@pytest.mark.parametrize("material", [STEEL, COATED, LAYER], ids=["steel", "coated", "layer"])
def test_compliant_surfaces_against_the_dense_solver(periodic, material):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        grid = Grid.from_domain(*map(int, rng.integers(2, 11, 2)), (-1, 1, -0.5, 1.0))
        gap, compliance = 1e-3 * rng.random(grid.shape), 10 ** rng.uniform(-8, -4)
        stiff = ContactProblem(grid, material, gap, periodic=periodic)
        soft = ContactProblem(grid, material, gap, periodic=periodic, surface_compliance=compliance)
        dense, n = DenseProblem(soft), grid.n
        own = compliance * (np.eye(n) - (1 / n if soft.grid.doubly_periodic else 0))
        np.testing.assert_allclose(dense.matrix - DenseProblem(stiff).matrix, own, atol=1e-6 * compliance)
        load = (0.1 if material is LAYER else 1500) * rng.random()
        found = solved(soft, load=load)
        uniform = soft.kernel.uniform_compliance(soft.grid) * found.mean_pressure
        exact, approach = dense.under(load, found.approach - uniform)
        assert found.converged and found.approach - uniform == pytest.approx(approach, rel=1e-3, abs=1e-7)
        size = dense.energy(found.pressure)
        assert dense.energy(found.pressure - exact) <= found.error_bound * size * (1 + 1e-6) + 1e-13 * size


def test_a_very_compliant_surface_is_winklers():
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    problem = ContactProblem(grid, STEEL, Sphere(20), surface_compliance=1.0)
    found = solved(problem, approach=0.01)
    winkler = np.maximum(0.01 - Sphere(20).shape_on(grid), 0)
    np.testing.assert_allclose(found.pressure, winkler, atol=1e-4 * winkler.max())


def test_stiffness_of_a_compliant_surface_gives_no_conductance():
    """It is that of bodies and surface in series if all cells are in contact."""
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    problem = ContactProblem(grid, STEEL, np.zeros(grid.shape), surface_compliance=1.0)
    with ContactSolver(problem) as solver:
        found = solver.with_stiffness(solver.solve(approach=0.01))
    assert found.stiffness == pytest.approx(grid.area / 1.0, rel=1e-3) and found.conductance_width is None


def test_without_compliance_nothing_changes():
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    plain, none, tiny = (
        ContactProblem(grid, STEEL, Sphere(20), surface_compliance=c) for c in (0, 0.0, 1e-16)
    )
    pressure = solved(plain, load=100).pressure
    assert np.array_equal(pressure, solved(none, load=100).pressure)
    np.testing.assert_allclose(solved(tiny, load=100).pressure, pressure, atol=1e-4 * pressure.max())
    assert plain.kernel == none.kernel != tiny.kernel == CompliantKernel(plain.kernel, 1e-16)
    assert plain.reference(0.01) is not None and tiny.reference(0.01) is None


@pytest.mark.parametrize("method", ["norm", "fmg_v11", "fast"])
def test_other_methods_agree(method):
    grid = Grid.from_domain(64, 64, (-0.36, 0.36, -0.36, 0.36))
    problem = ContactProblem(grid, STEEL, Sphere(10), surface_compliance=1e-6)
    found = solved(problem, method, load=50)
    assert found.converged and found.max_pressure == pytest.approx(791.236, rel=1e-4)


@pytest.mark.parametrize("distance", [10, 1000, 1e5])
def test_a_wave_in_full_contact_decays_exactly(distance):
    grid, k, q = Grid.from_domain(48, 32, (0, 1, 0, 1)), 1e-9, 4 * np.pi
    wave = 1e-4 * np.cos(q * grid.x()) * np.ones((32, 1))
    with ContactSolver(ContactProblem(grid, STEEL, wave, periodic=True)) as solver:
        path = solver.wear(k, 4 * distance, 4, mean_pressure=500)
        shapes = [wave + solution.worn_depth for solution in path]
    factor = 1 / (1 + k * distance * STEEL.contact_modulus * q / 2)
    for step, shape in enumerate(shapes):
        np.testing.assert_allclose(shape - shape.mean(), wave * factor ** (step + 1), atol=1e-12)
    np.testing.assert_allclose(
        path.table["worn_volume"], k * 500 * path.table["sliding_distance"], rtol=1e-12
    )


@pytest.mark.parametrize("periodic", [None, True, "x"])
def test_volume_of_archard_and_the_worn_shape(periodic, tmp_path):
    grid, k = Grid.from_domain(48, 48, (-0.36, 0.36, -0.36, 0.36)), 1e-9
    with ContactSolver(ContactProblem(grid, STEEL, Sphere(10), periodic=periodic)) as solver:
        path = solver.wear(k, 4000, 8, load=50)
        *_, last = solutions = list(path)
        plain = solver.solve(load=50)
    assert path.table["worn_volume"] == pytest.approx(k * 50 * path.table["sliding_distance"], rel=1e-12)
    assert np.diff(path.table["max_pressure"]).max() < 0 < np.diff(path.table["indentation"]).min()
    assert plain.extra == {} and plain.max_pressure > solutions[0].max_pressure
    np.testing.assert_allclose(last.gap, last.undeformed_distance + last.displacement, atol=1e-15)
    worn = Sphere(10).shape_on(grid) + last.worn_depth - last.approach
    np.testing.assert_allclose(last.undeformed_distance, worn, atol=1e-12)
    elastic = ContactProblem(plain.grid, STEEL, Sphere(10).shape_on(grid) + last.worn_depth)
    assert solved(elastic, load=50).max_pressure == pytest.approx(last.max_pressure, rel=1e-3)
    last.save(tmp_path / "worn.h5")
    read = read_result(tmp_path / "worn.h5")
    assert np.array_equal(read.worn_depth, last.worn_depth) and read.worn_volume == last.worn_volume
    assert [solution.sliding_distance for solution in solutions] == path.table["sliding_distance"].tolist()
    assert "stiffness_by_differences" not in path.table  # the bodies change between the steps
    assert read.sliding_distance == 4000 and read.units["worn_depth"] == "mm"


def test_implicit_steps_do_not_oscillate():
    """The pressure of a worn ball has one hill, at steps 50 times those at which explicit ones oscillate."""
    grid, step = Grid.from_domain(48, 48, (-0.36, 0.36, -0.36, 0.36)), 10 / STEEL.contact_modulus
    with ContactSolver(ContactProblem(grid, STEEL, Sphere(10))) as solver:
        *_, last = solver.wear(step * grid.dx, 5, 5, load=50)
    section = last.pressure[24, 24:]
    assert np.diff(section[section > 0]).max() < 1e-3 * section.max()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"coefficient": -1}, "coefficient -1: must be a positive number"),
        ({"distance": 0}, "distance 0: must be a positive number"),
        ({"steps": 1.5}, "steps 1.5: must be a whole number from 1"),
        ({"load": [1, 2]}, "2 values of load for 3 steps"),
        ({"load": None}, "exactly one of"),
    ],
)
def test_wrong_wear_is_refused(arguments, message):
    problem = ContactProblem(Grid.from_domain(8, 8, (-1, 1, -1, 1)), STEEL, Sphere(10))
    with ContactSolver(problem) as solver, pytest.raises(InputError, match=message):
        solver.wear(**{"coefficient": 1e-9, "distance": 10, "steps": 3, "load": 5} | arguments)


@pytest.mark.parametrize("compliance", [-1, np.nan, "soft", np.ones((8, 9)), True])
def test_wrong_compliances_are_refused(compliance):
    with pytest.raises(InputError, match="surface_compliance: "):
        ContactProblem(
            Grid.from_domain(8, 8, (-1, 1, -1, 1)), STEEL, Sphere(10), surface_compliance=compliance
        )


def test_stiffness_conductance_and_compliance_are_those_of_the_bodies():
    steel = STEEL.conducting(resistivity=(1e-7, 1e-7))
    problem = ContactProblem(Grid.from_domain(32, 32, (-0.4, 0.4, -0.4, 0.4)), steel, Sphere(10))
    with ContactSolver(problem) as solver:
        *_, last = path = list(solver.wear(1e-6, np.array(40), np.int64(2), load=50, stiffness=True))
        stiffness = solver.stiffness(last)
        solver.close()
    worn = ContactProblem(problem.grid, steel, Sphere(10).shape_on(problem.grid) + last.worn_depth)
    fresh = solved(worn, load=50)
    assert last.stiffness == stiffness == pytest.approx(fresh.stiffness, rel=0.02)
    assert last.electrical_conductance == pytest.approx(fresh.electrical_conductance, rel=0.02)
    assert "surface_compliance" not in last.problem and len(path) == 2
    soft = ContactProblem(problem.grid, steel, Sphere(10), surface_compliance=1e-5)
    with ContactSolver(soft) as solver:
        own = solver.solve(load=50)
        [last] = solver.wear(1e-6, 40, 1, load=50)
    assert last.problem["surface_compliance"] == 1e-5
    assert own.stiffness > 0 and own.electrical_conductance is own.conductance_width is None


def test_unloading_with_a_hardness_keeps_the_compliance():
    grid = Grid.from_domain(32, 32, (-0.4, 0.4, -0.4, 0.4))
    problem = ContactProblem(grid, STEEL, Sphere(10), surface_compliance=1e-6, hardness=400)
    with ContactSolver(problem) as solver:
        loaded, less = solver.path(load=[60, 20])
        shape = Sphere(10).shape_on(grid) + loaded.plastic_depth
        expected = solved(ContactProblem(grid, STEEL, shape, surface_compliance=1e-6), load=20)
    np.testing.assert_allclose(less.pressure, expected.pressure, atol=1e-4 * expected.max_pressure)


def test_compliant_surfaces_have_no_theory_of_half_spaces():
    waves = 1e-4 * np.random.default_rng(0).random((16, 16))
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1), periodic=True)
    stiff, soft = (ContactProblem(grid, STEEL, surfaces=[waves], surface_compliance=c) for c in (0, 1e-7))
    facts = [solved(problem, load=5).problem for problem in (stiff, soft)]
    assert [any("persson" in name for name in names) for names in facts] == [True, False]


def test_rows_do_not_resume_a_path():
    problem = ContactProblem(Grid.from_domain(8, 8, (-1, 1, -1, 1)), STEEL, Sphere(10))
    with ContactSolver(problem) as solver:
        path = solver.wear(1e-9, 10, 3, load=5)
        next(iter(path))
        with pytest.raises(InputError, match="cannot be resumed"):
            path.resume_after(path.rows)


@pytest.mark.mpi(2, 3)
def test_ranks_agree(comm):
    problem = ContactProblem(Grid.from_domain(64, 48, (-0.4, 0.4, -0.3, 0.3)), STEEL, Sphere(10))
    with ContactSolver(problem, comm=comm) as solver:
        shared = [solution.gather() for solution in solver.wear(1e-9, 100, 2, load=50)]
    if comm.rank == 0:
        with ContactSolver(problem, comm=MPI.COMM_SELF) as solver:
            for one, other in zip(shared, solver.wear(1e-9, 100, 2, load=50), strict=True):
                np.testing.assert_allclose(one.pressure, other.pressure, atol=1e-5 * other.max_pressure)
                np.testing.assert_allclose(
                    one.worn_depth, other.worn_depth, atol=1e-5 * other.worn_depth.max()
                )
