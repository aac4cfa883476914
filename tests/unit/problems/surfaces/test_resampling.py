"""Resampled surfaces: volumes, exact surfaces, order, holes, and what is refused."""

import h5py
import numpy as np
import pytest
from running import assert_proved_equal

from app import ContactProblem, Grid, InputError, Material, Sphere, read_surface, refine, solve
from app.problems.surfaces.resampling import ResampledSurface

from ..from_options import problem_from


def made(**texts):
    return problem_from(problem="rough", surface_resample="", load=1, **texts)


STEEL = Material.from_contact_modulus(115e3)
ROUGH = np.random.default_rng(3).normal(size=(12, 18))
CELL = 0.5, 0.25  # sides of 9 and 3
PATCH = -4.5, 4.5, -1.5, 1.5


def resampled(heights, cell=CELL):
    return ResampledSurface(read_surface(heights, "mm", spacing=cell))


def quadratic(grid):
    """Means over cells of a surface without an axis of symmetry."""
    x, y = grid.x()[None, :], grid.y()[:, None]
    return 1 + x + 2 * y + 0.3 * (x**2 + grid.dx**2 / 12) - 0.2 * (y**2 + grid.dy**2 / 12) + x * y


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("shape", [(12, 18), (6, 18), (12, 6), (4, 3), (1, 1)])
def test_whole_blocks_of_cells_get_their_means(shape, periodic):
    grid = Grid.from_domain(shape[1], shape[0], PATCH, periodic)
    expected = read_surface(ROUGH, "mm", spacing=CELL).averaged(shape).heights()
    np.testing.assert_allclose(resampled(ROUGH).heights_on(grid), expected, atol=1e-14)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("cells", [(17, 29), (7, 5), (18, 100), (36, 24)])
def test_volume_is_kept_and_each_rank_makes_the_same_rows(cells, periodic):
    grid, surface = Grid.from_domain(*cells, PATCH, periodic), resampled(ROUGH)
    heights = surface.heights_on(grid)
    assert heights.mean() == pytest.approx(ROUGH.mean(), abs=1e-14)
    np.testing.assert_array_equal(surface.heights_on(grid, slice(2, 5)), heights[2:5])
    assert surface.heights_on(grid, slice(3, 3)).shape == (0, cells[0])


@pytest.mark.parametrize("patch", [PATCH, (-3, 2, -1, 0.25)], ids=["all", "a part"])
@pytest.mark.parametrize("cells", [(17, 29), (100, 3)])
def test_quadratic_surfaces_are_exact(cells, patch):
    """About the middle of the patch, wherever that lies."""
    own = Grid.from_domain(18, 12, PATCH)
    grid = Grid.from_domain(*cells, patch)
    middle = Grid(*cells, grid.dx, grid.dy, -cells[0] * grid.dx / 2, -cells[1] * grid.dy / 2)
    np.testing.assert_allclose(resampled(quadratic(own)).heights_on(grid), quadratic(middle), atol=1e-11)


def test_resampling_of_a_wave_is_of_third_order():
    def wave(n):
        grid = Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5), periodic=True)
        mean = np.sinc(1 / n)  # over a cell, of a wave that is 1 in its middle
        return grid, mean**2 * np.cos(2 * np.pi * grid.x())[None] * np.sin(2 * np.pi * grid.y())[:, None]

    grid, exact = wave(150)
    errors = [
        np.abs(resampled(wave(n)[1], (1 / n, 1 / n)).heights_on(grid) - exact).max() for n in (16, 32, 64)
    ]
    assert errors[0] > 7 * errors[1] > 49 * errors[2] and errors[2] < 1e-5


@pytest.mark.parametrize("n", [20, 10, 40, 13])
def test_cells_without_any_known_point_are_missing(n):
    heights = np.arange(20.0) + np.arange(20.0)[:, None]
    heights[5:9, 6:10] = np.nan
    grid = Grid.from_domain(n, n, (0, 20, 0, 20))
    heights = resampled(heights, (1, 1)).heights_on(grid)
    start, stop = np.arange(n) * 20 / n, np.arange(1, n + 1) * 20 / n
    in_x, in_y = ((start >= low - 1e-9) & (stop <= high + 1e-9) for low, high in ((6, 10), (5, 9)))
    np.testing.assert_array_equal(np.isnan(heights), in_y[:, None] & in_x)
    plane = grid.x() + grid.y()[:, None] - 1  # which filled points continue
    np.testing.assert_allclose(heights[~np.isnan(heights)], plane[~np.isnan(heights)], atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
@pytest.mark.parametrize("periodic", [False, True])
def test_few_heights_keep_their_mean(n, periodic):
    grid = Grid.from_domain(7, 5, (0, n, 0, 5), periodic)
    heights = resampled(np.arange(5.0 * n).reshape(5, n), (1, 1)).heights_on(grid)
    assert heights.mean() == pytest.approx((5 * n - 1) / 2) and np.isfinite(heights).all()


def test_a_larger_patch_is_refused():
    surface = resampled(ROUGH)
    with pytest.raises(InputError, match=r"is 9 x 3 mm, the domain 9.1 x 3 mm; the domain must be no larger"):
        ContactProblem(Grid.from_domain(8, 8, (0, 9.1, 0, 3)), STEEL, surfaces=[surface])
    unknown = read_surface(ROUGH, "mm").resampled()  # has no size, and takes the patch's
    grid = Grid.from_domain(17, 29, PATCH)
    np.testing.assert_array_equal(unknown.heights_on(grid), surface.heights_on(grid))


def test_a_measured_sphere_has_the_contact_of_a_sphere():
    own, fine = (Grid.from_domain(n, n, (-0.4, 0.4, -0.4, 0.4)) for n in (20, 96))
    heights = -(own.x() ** 2 + own.y()[:, None] ** 2) / 20
    problem = ContactProblem(fine, STEEL, surfaces=[resampled(heights, (own.dx, own.dy))])
    loading = {"load": 100.0}
    sphere = solve(ContactProblem(fine, STEEL, Sphere(10)), **loading)
    solution = solve(problem, **loading)
    assert_proved_equal(solution, sphere)
    assert "resampled to cells of 8.33 x 8.33 um" in solution.problem["surface_read"]
    assert solution.problem["surface_resample"] == 1
    refined = refine(problem, until=0.01, **loading)
    assert refined.reached and refined.solution.grid.nx > 96


def test_two_files_of_different_cells_share_a_grid(tmp_path):
    """On the patch that both have, with the cells of the first, if nothing is said."""
    for name, n, width in (("a", 40, 0.01), ("b", 24, 0.015)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["heights"] = np.full((n, n), 1.0 + (name == "b"))
            file["heights"].attrs.update(unit="um", spacing=(width, width), spacing_unit="mm")
    files = {"surface_file": str(tmp_path / "a.h5"), "surface_file2": str(tmp_path / "b.h5")}
    problem = made(**files)
    assert problem.grid.shape == (36, 36) and problem.grid.dx == pytest.approx(0.01)
    np.testing.assert_allclose(problem.shape_on(problem.grid), -3e-3, rtol=1e-12)
    problem = made(**files, grid="50,7", domain="0,0.1,0,0.3")
    assert problem.grid.shape == (7, 50) and problem.grid.x0 == 0
    with pytest.raises(InputError, match=r"b.h5: is 0.36 x 0.36 mm, the domain 0.4 x 0.3 mm"):
        made(**files, domain="0,0.4,0,0.3")


def test_filters_precede_resampling(tmp_path):
    np.save(tmp_path / "s.npy", ROUGH)
    texts = {"surface_file": str(tmp_path / "s.npy"), "surface_unit": "mm", "surface_s_filter": "1.5"}
    texts |= {"grid": "30,31", "domain": "-4.5,4.5,-1.5,1.5"}
    grid = Grid.from_domain(30, 31, PATCH)
    expected = read_surface(ROUGH, "mm", spacing=CELL, s_filter=1.5).resampled().heights_on(grid)
    np.testing.assert_allclose(-made(**texts).shape_on(grid), expected, atol=1e-13)
