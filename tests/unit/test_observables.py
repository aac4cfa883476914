"""Where load and contact are, patches, distributions, stiffness: by definition, and as Hertz has them."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material, read_result
from app.api.summary import summary


@pytest.fixture(scope="module")
def of_hertz():
    return solve(hertz(128), APPROACH, None), hertz(128).reference(APPROACH)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("lift", [0.0, -0.3])
def test_the_indentation_counts_from_first_touch(tmp_path, periodic, lift):
    """Whatever zero heights have; what is prescribed, and what the file and a path say."""
    grid, steel = Grid.from_domain(32, 32, (-1, 1, -1, 1)), Material.from_contact_modulus(1e3)
    gap = np.random.default_rng(4).random(grid.shape) * 1e-2 + lift
    problem = ContactProblem(grid, steel, gap, periodic=periodic)
    with ContactSolver(problem) as solver:
        found = solver.solve(approach=gap.min() + 2e-3)
        assert found.indentation == pytest.approx(2e-3, rel=1e-9)
        assert solver.solve(approach=gap.min() - 1e-3).indentation == pytest.approx(-1e-3, rel=1e-9)
        path = solver.path(load=[found.load / 2, found.load])
        last = list(path)[-1]
    assert last.indentation == pytest.approx(2e-3, rel=1e-4)
    np.testing.assert_allclose(path.table["indentation"], path.table["approach"] - gap.min(), rtol=1e-9)
    last.save(tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").indentation == last.indentation
    assert ("beyond first touch" in summary(last.attributes | {"contact_patches": 1}, grid)) == (lift < 0)


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


def test_analytic_values_stand_beside(of_hertz):
    solution, known = of_hertz
    assert solution.attributes["analytic_load"] == pytest.approx(known.load)
    assert solution.attributes["analytic_semi_axis_major"] == pytest.approx(known.a)
    by_load = solve(hertz(64), None, None, load=known.load)
    assert by_load.attributes["analytic_approach"] == pytest.approx(APPROACH)
    for apart in (
        {"approach": -1.0},
        {"load": 0.0},
    ):  # a sphere touches before it reaches the centre of a cell
        found = solve(hertz(16), **{"approach": None, "method": None, **apart})
        assert not any(name.startswith("analytic") for name in found.attributes), apart


@pytest.mark.parametrize("periodic", [False, True])
def test_without_load_nothing_is_said_of_where_it_acts(periodic):
    """Nor has an approach, or a gap, of zero a sign."""
    x = np.linspace(-1, 1, 16) ** 2
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), np.add.outer(x, x), periodic=periodic)
    zero = {} if not periodic else {"approach": -0.0, "mean_gap": -0.0}
    for load, known in ((0.0, False), (1.0, not periodic)):
        with ContactSolver(problem) as solver:
            found = solver.solve(load=load)
        said = summary(found.attributes | zero, found.grid)
        assert ("centre of pressure" in said) == known
        assert "nan" not in said and "-0 " not in said
