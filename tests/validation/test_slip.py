"""Partial slip: Mindlin's sphere, and a dense solver with Cerruti's coupled displacements."""

from decimal import Decimal

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, InputError, Material, Sphere, read_result
from app.base.mpi import MPI

pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")
LOAD, FRICTION, RADIUS = 100.0, 0.3, 10.0


def ball(nu, n=128, side=0.5):
    patch = (-side / 2, side / 2, -side / 2, side / 2)
    return ContactProblem(Grid.from_domain(n, n, patch), Material.isotropic(210e3, nu), Sphere(RADIUS))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_sphere_of_mindlin(nu):
    """Johnson, Contact Mechanics (1985), Sec. 7.2 and 7.4."""
    problem = ball(nu)
    modulus, shear = problem.material.contact_modulus, 210e3 / 2 / (1 + nu)
    a = np.cbrt(3 * LOAD * RADIUS / (4 * modulus))
    both = 2 * (2 - nu) / shear
    tangential = [0.0, 5.0, 10.0, 25.0, FRICTION * LOAD]
    with ContactSolver(problem) as solver:
        slips = solver.slip(load=LOAD, friction=FRICTION, tangential_load=tangential)
    for found, load in zip(slips, tangential, strict=True):
        share = 1 - load / (FRICTION * LOAD)
        c = a * np.cbrt(share)
        displacement = 3 * FRICTION * LOAD / (16 * a) * both * (1 - share ** (2 / 3))
        loop = 1 - share ** (5 / 3) - 5 * (1 - share) / 6 * (1 + share ** (2 / 3))
        assert np.sqrt(found.stick_area / np.pi) == pytest.approx(c, abs=0.5 * problem.grid.dx)
        assert found.stick_area + found.slip_area == found.normal.contact_area
        assert found.tangential_displacement == pytest.approx(displacement, rel=3e-4)
        assert found.dissipated_energy == pytest.approx(
            9 * (FRICTION * LOAD) ** 2 / (10 * a) * both * loop, rel=1e-2
        )
        assert found.tangential_stiffness == pytest.approx(8 * c / both, rel=5e-3)
        assert (found.traction * problem.grid.cell_area).sum() == pytest.approx(load, rel=1e-9)
        assert (found.traction <= FRICTION * found.normal.pressure * (1 + 1e-12)).all()
        sliding = found.slip > 0
        np.testing.assert_array_equal(found.traction[sliding], (FRICTION * found.normal.pressure)[sliding])
        assert found.error_bound < 1e-3


def cerruti(grid, cells, nu, shear):
    """Return tangential displacements by tractions on cells of both bodies, shape (2 n, 2 n)."""
    y, x = np.nonzero(cells)
    x, y = grid.x()[x], grid.y()[y]
    dx, dy = x[:, None] - x, y[:, None] - y

    def over_cell(integral):
        corners = [(sx, sy) for sx in (0.5, -0.5) for sy in (0.5, -0.5)]
        return sum(np.sign(sx * sy) * integral(dx + sx * grid.dx, dy + sy * grid.dy) for sx, sy in corners)

    along_x = over_cell(lambda x, y: y * np.arcsinh(x / abs(y)))  # integral of x^2 / r^3
    along_y = over_cell(lambda x, y: x * np.arcsinh(y / abs(x)))
    mixed = over_cell(lambda x, y: -np.hypot(x, y))  # of x y / r^3
    inverse = along_x + along_y
    blocks = [
        [(1 - nu) * inverse + nu * along_x, nu * mixed],
        [nu * mixed, (1 - nu) * inverse + nu * along_y],
    ]
    return np.block(blocks) / (np.pi * shear)


def solve_coupled(matrix, limit, displacement):
    """Minimise q.Cq / 2 - d.q_x over |q| <= limit in every cell, by an accelerated projected gradient."""
    n, step = len(limit), 1 / np.linalg.eigvalsh(matrix)[-1]
    wanted = np.concatenate([np.full(n, displacement), np.zeros(n)])
    q = old = np.zeros(2 * n)
    for k in range(3000):
        at = q + k / (k + 3) * (q - old)
        moved = at - step * (matrix @ at - wanted)
        size = np.hypot(moved[:n], moved[n:])
        old, q = q, moved * np.tile(np.minimum(1, limit / np.maximum(size, 1e-300)), 2)
    return q


@pytest.mark.parametrize(
    ("nu", "displacement_error", "traction_error"), [(0.0, 1e-5, 1e-3), (0.3, 1e-3, 0.04), (0.5, 3e-3, 0.08)]
)
def test_dense_solver_with_coupling(nu, displacement_error, traction_error):
    """Without Poisson's ratio the discrete problem is solved exactly; with it, as well as the page says."""
    problem = ball(nu, 24)
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        found = solver.slip(load=LOAD, friction=FRICTION, tangential_load=15)
    cells, shear = found.normal.contact, 210e3 / 2 / (1 + nu)
    matrix, limit = cerruti(problem.grid, cells, nu, shear), FRICTION * found.normal.pressure[cells]
    low, high = 0.5 * found.tangential_displacement, 1.5 * found.tangential_displacement
    for _ in range(20):
        middle = (low + high) / 2
        q = solve_coupled(matrix, limit, middle)
        total = q[: len(limit)].sum() * problem.grid.cell_area
        low, high = (middle, high) if total < 15 else (low, middle)
        if abs(total - 15) < 1e-6 * 15:
            break
    assert found.tangential_displacement == pytest.approx(middle, rel=displacement_error)
    ours = np.concatenate([found.traction[cells], np.zeros(len(limit))])
    assert np.linalg.norm(ours - q) < traction_error * np.linalg.norm(q)
    print(
        nu,
        found.tangential_displacement / middle - 1,
        np.linalg.norm(ours - q) / np.linalg.norm(q),
        abs(q[len(limit) :]).max() / FRICTION / found.normal.max_pressure,
    )


@pytest.mark.parametrize("periodic", [True, "x"])
def test_periodic_patches_keep_the_conditions(periodic):
    rng = np.random.default_rng(1)
    grid = Grid.from_domain(32, 24, (0, 1, 0, 1))
    problem = ContactProblem(
        grid, Material.isotropic(1e3, 0.3), 0.01 * rng.random(grid.shape), periodic=periodic
    )
    with ContactSolver(problem) as solver:
        found = solver.slip(load=3.0, friction=0.5, tangential_load=1.0)
    assert 0 < found.stick_area < found.normal.contact_area
    assert (found.stuck.contact <= found.normal.contact).all()
    assert (found.slip >= 0).all() and not found.slip[found.stuck.contact].any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tangential_load": 31}, "the bodies slide; must be at most 30 N"),
        ({"tangential_load": -1}, "tangential_load -1: must be a number from 0"),
        ({"friction": 0}, "friction 0: must be a positive number"),
        ({"load": True}, "load True: must be a positive number"),
    ],
)
def test_wrong_loads_are_refused(arguments, message):
    with ContactSolver(ball(0.3, 16)) as solver, pytest.raises(InputError, match=message):
        solver.slip(**{"load": 100, "friction": 0.3, "tangential_load": 10} | arguments)


@pytest.mark.parametrize(
    ("material", "message"),
    [
        (Material.pair((210e3, 70e3), (0.3, 0.33)), "not similar"),
        (Material.from_contact_modulus(1e5), "E. alone does not give"),
        (Material.coated((4e5, 2e5), (0.2, 0.3), 0.1), "only for half-spaces without coatings"),
    ],
)
def test_other_bodies_are_refused(material, message):
    problem = ContactProblem(Grid.from_domain(16, 16, (-1, 1, -1, 1)), material, Sphere(10))
    with ContactSolver(problem) as solver, pytest.raises(InputError, match=message):
        solver.slip(load=100, friction=0.3, tangential_load=10)


def test_compliant_surfaces_are_refused():
    """Their normal compliance has no constant ratio to the tangential one."""
    problem = ContactProblem(
        Grid.from_domain(16, 16, (-1, 1, -1, 1)),
        Material.isotropic(210e3, 0.3),
        Sphere(10),
        surface_compliance=1e-6,
    )
    with ContactSolver(problem) as solver, pytest.raises(InputError, match="not with a surface compliance"):
        solver.slip(load=100, friction=0.3, tangential_load=10)


def test_any_friction_has_finite_numbers():
    with ContactSolver(ball(0.3, 16)) as solver:
        found = solver.slip(load=100, friction=1e300, tangential_load=10)
        full = solver.slip(load=Decimal(100), friction=0.29, tangential_load=29)  # 0.29 * 100 < 29
    assert found.dissipated_energy == 0 and found.error_bound == np.inf  # The traction is lost in rounding.
    assert found.tangential_displacement == pytest.approx(10 / found.tangential_stiffness)
    assert full.stick_area == 0 < full.slip_area


@pytest.mark.parametrize("share", [1e-3, 1e-5, 1e-7, 1e-9, 1e-12])
def test_small_tangential_loads_move_the_bodies_in_proportion(share):
    with ContactSolver(ball(0.3, 32)) as solver:
        found = solver.slip(load=LOAD, friction=FRICTION, tangential_load=share * FRICTION * LOAD)
    assert found.tangential_displacement * found.tangential_stiffness == pytest.approx(
        found.tangential_load, rel=1e-3
    )


@pytest.mark.parametrize("tangential_load", [0, 20, 30])
def test_a_file_has_the_normal_solution_and_the_slip(tangential_load, tmp_path):
    with ContactSolver(ball(0.3, 32)) as solver:
        found = solver.slip(load=LOAD, friction=FRICTION, tangential_load=tangential_load)
    found.save(tmp_path / "slip.h5", specimen="A")
    for taken in ({"traction": found.traction}, {"slip": 1}, {"friction": 1}):
        with pytest.raises(InputError, match="exists already; choose another name"):
            found.save(tmp_path / "slip.h5", **taken)
    read = read_result(tmp_path / "slip.h5")
    assert np.array_equal(read.pressure, found.normal.pressure) and read.specimen == "A"
    assert np.array_equal(read.traction, found.traction) and np.array_equal(read.slip, found.slip)
    assert (read.units["traction"], read.units["slip"]) == ("N/mm2", "mm")
    assert read.attributes.items() >= found.numbers.items()
    assert read.error_bound == found.normal.error_bound and read.traction_error_bound == found.error_bound
    for drawn in found.plot(), read.plot("slip"):
        share = drawn.axes[0].images[-1].get_array()  # of the traction over friction times pressure
        assert share.max() <= 1 + 1e-12
        assert (share > 1 - 1e-12).sum() == (found.normal.contact & ~found.stuck.contact).sum()


@pytest.mark.mpi(2, 3)
def test_ranks_write_one_file(comm, tmp_path):
    file = comm.bcast(tmp_path / "slip.h5")
    with ContactSolver(ball(0.3, 32), comm=comm) as solver:
        found = solver.slip(load=LOAD, friction=FRICTION, tangential_load=20)
    found.save(file)
    assert np.array_equal(read_result(file).traction[found.normal.slabs.rows], found.traction)


@pytest.mark.mpi(2, 3)
def test_ranks_agree(comm):
    with ContactSolver(ball(0.3, 48), comm=comm) as solver:
        shared = solver.slip(load=LOAD, friction=FRICTION, tangential_load=20)
    with ContactSolver(ball(0.3, 48), comm=MPI.COMM_SELF) as solver:
        alone = solver.slip(load=LOAD, friction=FRICTION, tangential_load=20)
    for name in ("tangential_displacement", "stick_area", "tangential_stiffness", "dissipated_energy"):
        assert getattr(shared, name) == pytest.approx(getattr(alone, name), rel=1e-5)
