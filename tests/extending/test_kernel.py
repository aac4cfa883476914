"""An orthotropic half-space: its kernel, and contact with an ellipsoid."""

import numpy as np
import pytest
from processes import run
from running import assert_proved_equal

from app import ContactProblem, Grid, Material, SelfAffineSurface, Sphere, solve
from app.api.subsurface import stress
from app.base.errors import InputError
from app.halfspace.influence import dense_matrix

YOUNG, POISSON = 210e3, 0.3
GRID = Grid.from_domain(64, 64, (-0.8, 0.8, -0.8, 0.8))


@pytest.fixture
def fibres(example):
    """Kernel of a composite with fibres along x."""
    stiffness = np.diag([140e3, 12e3, 12e3, 3.5e3, 5e3, 5e3])
    for i, j, value in ((0, 1, 5e3), (0, 2, 5e3), (1, 2, 6e3)):
        stiffness[i, j] = stiffness[j, i] = value
    return example("kernel").Orthotropic.from_stiffness(stiffness)


def ellipsoid(kernel, a, b, highest):
    """Approach and half curvatures in x and y for the pressure highest * sqrt(1 - (x/a)^2 - (y/b)^2).

    This pressure is an integral of plane waves over all directions, each of which displaces a parabola.
    """
    angle = 2 * np.pi * np.arange(720) / 720
    x, y = np.cos(angle), np.sin(angle)
    width = np.hypot(a * x, b * y)
    wave = np.pi**2 / 2 * a * b * highest * kernel.wave_compliance(x, y) / width
    return wave.mean(), (wave * (x / width) ** 2).mean(), (wave * (y / width) ** 2).mean()


@pytest.mark.parametrize(("nx", "ny", "dx", "dy"), [(30, 20, 1.0, 1.0), (9, 24, 1.3, 0.4)])
def test_isotropic_body_is_the_half_space(nx, ny, dx, dy, example):
    shear = YOUNG / (2 * (1 + POISSON))
    stiffness = np.diag([2 * shear] * 3 + [shear] * 3)
    stiffness[:3, :3] += YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    kernel = example("kernel").Orthotropic.from_stiffness(stiffness)
    half_space = Material.pair((YOUNG, np.inf), (POISSON, 0.0)).kernel
    assert kernel.compliance == pytest.approx(half_space.compliance, rel=1e-14)
    grid = Grid(nx, ny, dx, dy)
    numbers, expected = (one.coefficients(grid, np.arange(ny), nx) for one in (kernel, half_space))
    assert numbers == pytest.approx(expected, rel=1e-11)
    periodic = Grid(nx, ny, dx, dy, periodic=True)
    frequencies = np.arange(nx // 2 + 1), np.arange(ny // 2 + 1)
    numbers, expected = (one.eigenvalues(periodic, *frequencies) for one in (kernel, half_space))
    assert numbers == pytest.approx(expected, rel=1e-13)


def test_pressure_on_an_ellipse_is_hertz_s(fibres):
    approach, x2, y2 = ellipsoid(fibres, 0.5, 0.35, 100.0)
    problem = ContactProblem(GRID, Material.from_kernel(fibres), lambda x, y: x2 * x**2 + y2 * y**2)
    solution = solve(problem, approach=approach)
    assert solution.converged and not solution.fallbacks
    assert solution.load == pytest.approx(2 / 3 * np.pi * 0.5 * 0.35 * 100, rel=1e-3)
    assert solution.max_pressure == pytest.approx(100, rel=2e-3)
    x, y = GRID.x(), GRID.y()[:, None]
    exact = 100 * np.sqrt(np.maximum(1 - (x / 0.5) ** 2 - (y / 0.35) ** 2, 0))
    assert np.linalg.norm(solution.pressure - exact) < 0.01 * np.linalg.norm(exact)
    assert solution.attributes["kernel"] == "Orthotropic" and "Orthotropic" in solution.summary()


@pytest.mark.parametrize("method", ["norm", "fmg_v11"])
def test_methods_of_the_paper_agree_with_the_default_one(fibres, method):
    grid = Grid.from_domain(32, 32, (-0.8, 0.8, -0.8, 0.8))
    problem = ContactProblem(grid, Material.from_kernel(fibres), Sphere(30.0), hardness=60.0)
    ours, papers = (solve(problem, load=30.0, method=name) for name in (None, method))
    assert ours.plastic_area > 0
    assert_proved_equal(ours, papers)


PROBLEM = """
from kernel import Orthotropic
from problem import Cone
from app import Material

class Composite(Cone):
    @classmethod
    def from_options(cls, grid, material, options):
        stiffness = [[140e3, 5e3, 5e3, 0, 0, 0], [5e3, 12e3, 6e3, 0, 0, 0], [5e3, 6e3, 12e3, 0, 0, 0],
                     [0, 0, 0, 3.5e3, 0, 0], [0, 0, 0, 0, 5e3, 0], [0, 0, 0, 0, 0, 5e3]]
        return cls(grid, Material.from_kernel(Orthotropic.from_stiffness(stiffness)), options["cone_slope"])
"""


def test_kernel_on_the_command_line(folder):
    """The problem's material is used, also if the command adds a hardness."""
    (folder / "composite.py").write_text(PROBLEM)
    command = "-m", "app.solve", "-problem", "python", "-problem_type", "composite.Composite", "-grid", "32"
    done = run(
        *command,
        "-domain",
        "-1,1,-1,1",
        "-contact_modulus",
        "1",
        "-load",
        "100",
        "-hardness",
        "1500",
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    assert ": solved (" in done.stdout and "bodies with the kernel Orthotropic" in done.stdout


@pytest.mark.parametrize("series", [None, (1.0, 0.9), (1.0, -0.5, 0.3)])
def test_bounds_of_the_base_class_hold(fibres, series):
    fibres = type(fibres)(series) if series else fibres
    for grid in (Grid(10, 12, 1.0, 1.0), Grid(12, 8, 1.0, 2.5)):
        matrix = dense_matrix(grid, fibres)
        assert fibres.is_positive(grid) and matrix.min() > 0
        assert 0 < fibres.smallest_eigenvalue(grid) <= np.linalg.eigvalsh(matrix)[0]
        assert matrix.sum(axis=1).max() <= fibres.middle_displacement([2 * side for side in grid.sides[::-1]])
        periodic = Grid(grid.nx, grid.ny, grid.dx, grid.dy, periodic=True)
        values = np.linalg.eigvalsh(dense_matrix(periodic, fibres))
        assert fibres.smallest_eigenvalue(periodic) <= values[1] * (1 + 1e-12)
        assert values[-1] <= fibres.largest_eigenvalue(periodic) * (1 + 1e-3)  # sampled waves


@pytest.mark.parametrize("periodic", [False, True])
def test_rough_contact_takes_as_many_products_as_on_a_half_space(fibres, periodic):
    grid, surface = (
        Grid(128, 128, 1 / 128, 1 / 128),
        SelfAffineSurface(0.8, 0.25, 1 / 16, (1.0, 1.0), 3, rms_slope=0.1),
    )
    materials = Material.from_kernel(fibres), Material.from_contact_modulus(1 / (np.pi * fibres.compliance))
    ours, half_space = (
        solve(ContactProblem(grid, material, surfaces=[surface], periodic=periodic), mean_pressure=20.0)
        for material in materials
    )
    assert ours.converged and not ours.fallbacks
    assert ours.operator_applications < 1.3 * half_space.operator_applications


def test_what_is_not_known_of_the_body_is_refused_in_one_line(fibres):
    material = Material.from_kernel(fibres)
    problem = ContactProblem(GRID, material, lambda x, y: x**2 + y**2)
    with pytest.raises(
        InputError, match="^stress: is not known below the surface of bodies with the kernel Orthotropic$"
    ):
        stress(solve(problem, load=10), poisson_ratio=0.3)
    for periodic in ("x", "love"):
        with pytest.raises(InputError, match=f"^periodic: '{periodic}'; must be True"):
            solve(ContactProblem(GRID, material, lambda x, y: x**2, periodic=periodic), load=10)
    with pytest.raises(InputError, match="^resistivity, thermal_conductivity: not for such bodies"):
        material.conducting(resistivity=1e-8)
    with pytest.raises(InputError, match="^kernel: 3; must be a Kernel$"):
        Material.from_kernel(3)
    with pytest.raises(InputError, match="^kernel: its compliance is 0; must be positive"):
        Material.from_kernel(type(fibres)([0, 1]))
    weak = Material.from_kernel(type(fibres)([1e-5, 2e-5]))
    with pytest.raises(InputError, match="^<Orthotropic, .* the compliance of some waves is not positive$"):
        solve(ContactProblem(GRID, weak, lambda x, y: x**2), load=10)
    assert problem.reference(0.01) is None and "Orthotropic" in repr(problem)


@pytest.mark.parametrize("wrong", [1.0, np.ones(3), 1j * np.ones(2), "soft", None])
def test_a_compliance_that_is_no_array_of_real_numbers_is_refused(wrong, fibres):
    class Wrong(type(fibres)):
        def wave_compliance(self, qx, qy=0.0):
            return wrong

    with pytest.raises(InputError, match="wave_compliance must return an array of real numbers"):
        solve(ContactProblem(GRID, Material.from_kernel(Wrong([1e-6])), Sphere(10)), load=1)
