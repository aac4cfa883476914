"""Contact spots and distributions."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from running import solve

from app import ContactProblem, Grid, Material, read_result
from app.base.errors import InputError


@pytest.fixture(scope="module")
def of_hertz():
    return solve(hertz(128), APPROACH, None), hertz(128).reference(APPROACH)


def two_spheres(x, y):
    """Of radii 20 and 10 mm about (-0.5, 0.25) and (0.5, -0.25), the second 2 um farther off."""
    return np.minimum(
        ((x + 0.5) ** 2 + (y - 0.25) ** 2) / 40, ((x - 0.5) ** 2 + (y + 0.25) ** 2) / 20 + 0.002
    )


# None: free; the last in a patch of contact.
@pytest.mark.parametrize("corner", [None, (-1.0, -0.5), (-0.5, -0.75)])
def test_contact_spots_have_loads_and_centres(tmp_path, corner):
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


def test_contact_spots_may_be_absent_or_periodic():
    assert [len(column) for column in solve(hertz(16), -1.0, None).patches()[:-1]] == [16] + [0] * 6
    flat = ContactProblem(Grid.from_domain(8, 4, (0, 2, 0, 1), True), hertz(16).material, np.zeros((4, 8)))
    patches = solve(flat, None, None, load=2.0).patches()
    assert (patches.cells, patches.load) == (32, pytest.approx(2.0))
    assert np.isnan([patches.centre_x, patches.centre_y]).all()


def test_distributions_of_hertz(of_hertz):
    solution, known = of_hertz
    edges, density = solution.distribution("pressure", 10)
    middle = (edges[1:] + edges[:-1]) / 2
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    # So is 1 - (p / p_max)^2; cells on the rim have other pressures.
    uniform = 2 * middle / known.max_pressure**2
    assert density[2:] == pytest.approx(uniform[2:], rel=0.1)
    edges, density = solution.distribution("gap", 10, logarithmic=True)
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    assert np.diff(np.log(edges)) == pytest.approx(np.log(edges[-1] / edges[0]) / 10)
    with pytest.raises(InputError, match="allowed: pressure, gap"):
        solution.distribution("load")
    for bins in (0, 2.5):
        with pytest.raises(InputError, match="whole number of at least 1"):
            solution.distribution("gap", bins)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_distribution_of_one_value_has_one_filled_bin(logarithmic):
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
