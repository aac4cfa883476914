"""Where load and contact are, patches, distributions, stiffness: by definition, and as Hertz has them."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material, read_result
from app.base.errors import InputError
from app.cli.summary import summary


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


def two_spheres(x, y):
    """Of radii 20 and 10 mm about (-0.5, 0.25) and (0.5, -0.25), the second 2 um farther off."""
    return np.minimum(
        ((x + 0.5) ** 2 + (y - 0.25) ** 2) / 40, ((x - 0.5) ** 2 + (y + 0.25) ** 2) / 20 + 0.002
    )


@pytest.mark.parametrize(
    "corner", [None, (-1.0, -0.5), (-0.5, -0.75)]
)  # None: free; the last in a patch of contact
def test_patches_have_loads_and_places(tmp_path, corner):
    x0, y0 = corner or (-1.0, -0.5)
    grid = Grid.from_domain(64, 32, (x0, x0 + 2, y0, y0 + 1))

    def gap(x, y):
        return two_spheres((x + 1) % 2 - 1, (y + 0.5) % 1 - 0.5)

    found = solve(ContactProblem(grid, hertz(16).material, gap, bool(corner)), 0.005, None)
    found.save(tmp_path / "found.h5", patch=found.patches().labels)
    read = read_result(tmp_path / "found.h5")
    for solution in (found, read):
        patches = solution.patches()
        assert np.array_equal(patches.labels > 0, solution.contact == 1)
        assert list(patches.area) == list(solution.contact_patches()) and len(patches.cells) == 2
        assert patches.load.sum() == pytest.approx(solution.load, rel=1e-12)
        for k, (load, cells) in enumerate(zip(patches.load, patches.cells, strict=True)):
            p = solution.pressure[patches.labels == k + 1]
            assert (len(p), p.max()) == (cells, patches.max_pressure[k])
            assert load == pytest.approx(p.sum() * grid.cell_area, rel=1e-12)
            # The mean of the cells, of those of a period that are nearest to the axis of the sphere.
            j, i = np.nonzero(patches.labels == k + 1)
            for at, centre, axis, first, period in (
                (solution.x[i], patches.centre_x[k], (-0.5, 0.5)[k], x0, 2.0),
                (solution.y[j], patches.centre_y[k], (0.25, -0.25)[k], y0, 1.0),
            ):
                away = (at - axis + period / 2) % period - period / 2
                assert first <= centre <= first + period
                assert (centre - axis - away.mean() + period / 2) % period == pytest.approx(
                    period / 2, rel=1e-12
                )
    assert np.array_equal(read.extra["patch"], patches.labels)


def test_patches_without_contact_and_all_around():
    assert [len(column) for column in solve(hertz(16), -1.0, None).patches()] == [16] + [0] * 6
    flat = ContactProblem(Grid.from_domain(8, 4, (0, 2, 0, 1), True), hertz(16).material, np.zeros((4, 8)))
    patches = solve(flat, None, None, load=2.0).patches()
    assert (patches.cells, patches.load) == (32, pytest.approx(2.0))
    assert np.isnan([patches.centre_x, patches.centre_y]).all()


def test_distributions_of_hertz(of_hertz):
    solution, known = of_hertz
    edges, density = solution.distribution("pressure", 10)
    middle = (edges[1:] + edges[:-1]) / 2
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    uniform = (
        2 * middle / known.max_pressure**2
    )  # so is 1 - (p / p_max)^2; cells on the rim have other pressures
    assert density[2:] == pytest.approx(uniform[2:], rel=0.1)
    edges, density = solution.distribution("gap", 10, logarithmic=True)
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    assert np.diff(np.log(edges)) == pytest.approx(np.log(edges[-1] / edges[0]) / 10)
    with pytest.raises(InputError, match="allowed: pressure, gap"):
        solution.distribution("load")
    for bins in (0, 2.5):
        with pytest.raises(InputError, match="whole number of at least 1"):
            solution.distribution("gap", bins)


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


@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_distribution_of_one_value_is_one_bin(logarithmic):
    alone = np.full((4, 5), 0.3)
    alone[1, 2] = 0.0
    material = Material.from_contact_modulus(1e5)
    one = solve(ContactProblem(Grid.from_domain(5, 4, (0, 1, 0, 1)), material, alone), 1e-6, None)
    assert one.contact_cells == 1
    edges, density = one.distribution("pressure", 7, logarithmic)
    assert np.isfinite(density).all()
    assert density @ np.diff(edges) == pytest.approx(1)
    assert edges[0] < one.max_pressure < edges[-1]
    assert (np.diff(edges) > 0).all()


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
