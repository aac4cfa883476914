"""NORM, Sec. 3: the paper's Hertz contact, its limits, and gaps from files."""

import numpy as np
import pytest
from mpi_norm import APPROACH, COUNTS, SMALL, hertz
from running import Sampled, assert_solves_lcp, solve

from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.output.result import read_result
from app.problems.gap_file import GapArray, GapFile


@pytest.fixture(scope="module")
def solutions():
    return {n: solve(hertz(n), APPROACH) for n in COUNTS}


def assert_counts(n, outer, inner):
    # The count of CG iterations depends on round-off: the problem is symmetric about both axes, so only
    # round-off makes unsymmetric components, which grow until CG has to remove them.
    expected_outer, expected_inner = COUNTS[n]
    assert outer == expected_outer
    assert inner == pytest.approx(expected_inner, rel=0.03, abs=3)


@pytest.mark.parametrize("n", COUNTS)
def test_iterations_on_hertz(solutions, n):
    outcome = solutions[n].outcome
    assert_counts(n, outcome.iterations, outcome.inner_iterations)
    assert_solves_lcp(solutions[n])
    history = solutions[n].history
    assert history["iteration"] == list(range(1, outcome.iterations + 1))
    assert sum(history["inner_iterations"]) == outcome.inner_iterations
    assert history["changed_cells"][-1] == 0
    assert history["residual"][-1] == outcome.residual <= 1e-6
    assert history["contact_cells"][-1] == solutions[n].contact.sum()
    # On Hertz's problem C shrinks from the start set to the solution.
    assert sum(history["added_cells"]) == 0
    assert (np.diff(history["contact_cells"]) <= 0).all()


@pytest.mark.mpi(2, 3)
def test_several_ranks_find_the_same(solutions, mpiexec, ranks, tmp_path):
    mpiexec(ranks, "mpi_norm.py", tmp_path / "found.npz")
    found = np.load(tmp_path / "found.npz")
    for n, alone in solutions.items():
        outer, inner, load = found[str(n)]
        assert_counts(n, outer, inner)
        assert load == pytest.approx(alone.load, rel=5e-6)  # both are solved to 1e-6
    alone = solve(hertz(*SMALL), APPROACH, lcp_rtol=1e-12)
    np.testing.assert_allclose(found["pressure"], alone.pressure, rtol=0, atol=1e-6)
    assert ((found["pressure"] > 0) == alone.contact).all()


def test_load_and_maximum_on_the_finest_grid(solutions):
    assert solutions[256].load == pytest.approx(82004.6, abs=0.05)
    assert solutions[256].pressure.max() == pytest.approx(1631.15, abs=0.02)


def test_converges_to_the_analytic_solution(solutions):
    # Measured orders: load 2.0, pressure 1.0 (its root singularity at the rim of the contact area).
    exact = hertz(32).reference(APPROACH)
    load_errors, pressure_errors = [], []
    for n, solution in solutions.items():
        grid = hertz(n).grid
        error = solution.pressure - exact.pressure(grid.x()[None, :], grid.y()[:, None])
        load_errors.append(abs(solution.load / exact.load - 1))
        pressure_errors.append(np.sqrt(np.mean(error**2)) / exact.max_pressure)
    refinements = np.log2(list(solutions))

    def order(errors):
        return -np.polyfit(refinements, np.log2(errors), 1)[0]

    assert order(load_errors) == pytest.approx(2, abs=0.2)
    assert order(pressure_errors) == pytest.approx(1, abs=0.1)
    assert load_errors[-1] < 1e-5
    assert pressure_errors[-1] < 1e-3


@pytest.mark.parametrize(("nx", "ny"), [(63, 65), (96, 20), (20, 96)])
def test_odd_grids_and_oblong_cells(nx, ny):
    solution = solve(hertz(nx, ny), APPROACH)
    assert_solves_lcp(solution)
    assert solution.load == pytest.approx(hertz(8).reference(APPROACH).load, rel=3e-3)


def test_sphere():
    material = Material(1000.0, 0.5)
    grid = Grid.from_domain(80, 80, (-1.3, 1.3, -1.3, 1.3))
    sphere = type(hertz(8))(grid, material, rx=5.0, ry=5.0)
    solution = solve(sphere, 0.2)
    # Johnson, Contact Mechanics, eqs. (4.22)-(4.24): a^2 = R delta, F = 4/3 E* sqrt(R delta^3)
    assert solution.load == pytest.approx(4 / 3 * 2000 * np.sqrt(5 * 0.2**3), rel=1e-3)
    assert solution.contact.sum() * grid.cell_area == pytest.approx(np.pi * 5 * 0.2, rel=0.02)


# ---------------------------------------------------------------------------------------- gaps from files


def write_gap(path, shape):
    import h5py

    if path.suffix == ".npy":
        np.save(path, shape)
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["measured/gap"] = shape
    else:
        np.savetxt(path, shape, fmt="%.17g", delimiter=", " if path.suffix == ".csv" else " ")


def gap_file(path, n):
    problem = hertz(n)
    return GapFile(problem.grid, problem.material, GapArray(str(path)))


@pytest.mark.parametrize("name", ["gap.npy", "gap.h5", "gap.txt", "gap.csv"])
def test_gap_from_a_file_is_the_same_problem(solutions, name, tmp_path):
    problem = hertz(32)
    write_gap(tmp_path / name, problem.shape_on(problem.grid))
    solution = solve(gap_file(tmp_path / name, 32), APPROACH)
    np.testing.assert_array_equal(solution.pressure, solutions[32].pressure)


def test_dataset_by_name_integers_and_byte_order(tmp_path):
    import h5py

    values = np.arange(12).reshape(3, 4)
    with h5py.File(tmp_path / "many.h5", "w") as file:
        file["a/b"], file["c"] = values.astype(">f4"), np.zeros((3, 4))
    np.save(tmp_path / "big_endian.npy", values.astype(">i2"))
    np.save(tmp_path / "fortran.npy", np.asfortranarray(values, float))
    (tmp_path / "odd.txt").write_text("# a comment\n0;1;2; 3\n\n4\t5 6 7\n8,9,10,11e0\n")
    for name in ("many.h5:/a/b", "big_endian.npy", "fortran.npy", "odd.txt"):
        gap = GapArray(str(tmp_path / name))
        assert gap.shape == (3, 4)
        rows = gap.rows(slice(1, 3))
        assert rows.dtype == np.float64
        np.testing.assert_array_equal(rows, values[1:])


def test_command_line_solves_a_gap_file_on_two_ranks(cli, tmp_path):
    problem = hertz(32)
    write_gap(tmp_path / "gap.npy", problem.shape_on(problem.grid))
    done = cli(
        *("-problem", "file", "-gap_file", tmp_path / "gap.npy", "-domain", "-10,10,-6,6"),
        *("-shear_modulus", 82000, "-poisson_ratio", 0.28, "-approach", APPROACH),
        *("-output", tmp_path / "out.h5", "-lcp_rtol", 1e-12),
        methods=["norm"],
        ranks=2,
    )
    assert (done.returncode, done.stderr) == (0, "")
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.attributes["ranks"] == 2
    alone = solve(problem, APPROACH, lcp_rtol=1e-12)
    np.testing.assert_allclose(result.pressure, alone.pressure, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(result.contact, alone.contact)
    np.testing.assert_allclose(result.gap, result.undeformed_distance + result.displacement, atol=1e-15)


@pytest.mark.parametrize("method", ["norm", "mg_v11"])
def test_holes_are_never_in_contact(method):
    problem = hertz(48)
    shape = problem.shape_on(problem.grid)
    holes = np.random.default_rng(3).random(shape.shape) < 0.15
    holes[:, 24] = True
    shape[holes] = np.nan
    solution = solve(Sampled(problem.grid, problem.material, shape), APPROACH, method)
    assert_solves_lcp(solution)
    assert not solution.contact[holes].any()
    assert (solution.pressure[holes] == 0).all()
    whole = solve(problem, APPROACH)
    assert solution.load < whole.load
    assert solution.pressure.max() > whole.pressure.max()  # what the holes cannot bear, others must


def test_values_in_holes_do_not_matter():
    problem = hertz(24)
    shape = problem.shape_on(problem.grid)
    shape[10:14, 3:20] = np.nan
    far = np.where(np.isnan(shape), 1e3, shape)
    with_holes = solve(Sampled(problem.grid, problem.material, shape), APPROACH, lcp_rtol=1e-12)
    without = solve(Sampled(problem.grid, problem.material, far), APPROACH, lcp_rtol=1e-14)
    np.testing.assert_allclose(with_holes.pressure, without.pressure, rtol=0, atol=1e-5)


# ---------------------------------------------------------------------------------------- ends of the range


@pytest.mark.parametrize("approach", [-1.0, -1e-12])
def test_bodies_apart(approach):
    solution = solve(hertz(16), approach)
    assert_solves_lcp(solution)
    assert solution.load == 0
    assert not solution.contact.any()
    assert "touch" in solution.outcome.reason


def test_bodies_that_just_touch():
    problem = hertz(15)  # a cell centre at the origin
    solution = solve(problem, 0.0)
    assert_solves_lcp(solution)
    assert solution.load == 0
    assert solution.contact.sum() == 1


def test_flat_gap_of_zero():
    problem = hertz(8)
    solution = solve(Sampled(problem.grid, problem.material, np.zeros((8, 8))), 0.0)
    assert solution.outcome.converged
    assert solution.load == 0


def test_no_contact_is_a_valid_answer(cli, tmp_path):
    done = cli("-grid", 16, "-approach", -0.1, "-output", tmp_path / "out.h5", methods=["hertz", "norm"])
    assert (done.returncode, done.stderr) == (0, "")
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.attributes["load"] == result.attributes["max_pressure"] == 0
    assert not result.pressure.any()
    np.testing.assert_array_equal(result.gap, result.undeformed_distance)


def test_contact_at_the_rim_is_solved_with_a_warning(cli, tmp_path):
    done = cli(
        *("-grid", 16, "-domain", "-3,3,-3,3", "-output", tmp_path / "out.h5"),
        methods=["hertz", "norm"],
        ranks=2,
    )
    assert done.returncode == 0
    warnings = done.stderr.splitlines()
    assert len(warnings) == 1
    assert warnings[0].startswith("warning: ")
    assert "rim" in warnings[0]
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.contact.all()
    assert np.abs(result.gap).max() < 1e-5
