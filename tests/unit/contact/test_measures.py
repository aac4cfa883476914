"""Mean gap, perimeter, corrected contact and roughness by their definitions."""

import numpy as np
import pytest
from running import solve

from app import ContactProblem, ContactSolver, Grid, Material
from app.api.summary import summary
from app.problems.statistics import roughness

SHAPE = 20, 24


DOMAIN = 0.0, 3.0, 0.0, 2.0  # cells are not square


PERIODIC = pytest.mark.parametrize("periodic", [False, "spectral", "love"])


def rough(periodic, holes=False):
    """A random surface; at approach -1e-3 mm part of the cells is in contact."""
    gap = 1e-3 * np.random.default_rng(3).normal(size=SHAPE)
    if holes:
        gap[3:6, 20:] = gap[-1, 4] = np.nan
    grid = Grid.from_domain(*SHAPE[::-1], DOMAIN)
    return ContactProblem(grid, Material.from_contact_modulus(1000.0), gap, periodic)


def faces(contact, periodic):
    """Count the faces across x and y between contact and no contact."""
    if not periodic:
        contact = np.pad(contact, 1)
    return tuple(np.count_nonzero(contact != np.roll(contact, 1, axis)) for axis in (1, 0))


@PERIODIC
@pytest.mark.parametrize("holes", [False, True])
def test_measures_are_as_defined(periodic, holes):
    solution = solve(rough(periodic, holes), -1e-3)
    grid, gap, contact = solution.grid, solution.gap, solution.contact
    cells = np.count_nonzero(~np.isnan(gap))
    assert 0.02 < solution.contact_fraction < 0.5
    assert solution.mean_pressure == pytest.approx(solution.load / 6.0, rel=1e-14)
    assert solution.mean_gap == pytest.approx(np.nanmean(gap), rel=1e-12)
    in_x, in_y = faces(contact, periodic)
    assert solution.perimeter == pytest.approx(in_x * grid.dy + in_y * grid.dx, rel=1e-14)
    per_face = (np.pi - 1 + np.log(2)) / 24
    corrected = (contact.sum() - per_face * (in_x + in_y)) / cells
    assert solution.contact_fraction_corrected == pytest.approx(corrected, rel=1e-14)
    assert solution.rms_height == pytest.approx(np.nanstd(solution.undeformed_distance), rel=1e-12)


@PERIODIC
def test_mean_gap_of_a_periodic_patch_is_that_of_the_undeformed_bodies(periodic):
    solution = solve(rough(periodic), -1e-3)
    mean = solution.undeformed_distance.mean()
    if periodic:
        assert solution.mean_gap == pytest.approx(mean, rel=1e-12)
    else:
        assert solution.mean_gap > mean  # pressure opens the gap beside it


def wave(x, y):
    return 0.01 * np.cos(2 * np.pi * 3 * x / 3.0 + 1.0) * np.cos(2 * np.pi * 2 * y / 2.0)


@pytest.mark.parametrize("cells", [(24, 20), (15, 17), (96, 80)])
def test_slope_of_a_wave_on_a_periodic_patch_is_exact(cells):
    grid = Grid.from_domain(*cells, DOMAIN, "spectral")
    solution = solve(ContactProblem(grid, Material.from_contact_modulus(1.0), wave), -0.009)
    assert solution.rms_slope == pytest.approx(0.01 / 2 * 2 * np.pi * np.hypot(1, 1), rel=1e-10)


@pytest.mark.parametrize("cells", [(24, 20), (15, 17)])
def test_slope_on_a_free_patch_is_by_differences(cells):
    grid = Grid.from_domain(*cells, DOMAIN)
    solution = solve(ContactProblem(grid, Material.from_contact_modulus(1.0), wave), -0.009)
    expected = roughness(solution.undeformed_distance, grid.dx, grid.dy).rms_slope
    assert solution.rms_slope == pytest.approx(expected, rel=1e-12)


def test_slope_leaves_out_holes_and_includes_faces_across_the_period():
    grid = Grid.from_domain(8, 4, (0.0, 8.0, 0.0, 4.0), "spectral")
    gap = np.tile([0.0, 1.0, 2.0, np.nan, 2.0, 2.0, 1.0, 0.0], (4, 1))
    solution = solve(ContactProblem(grid, Material.from_contact_modulus(1.0), gap), -1.0)
    # Of six faces in a row, the one around the patch is flat.
    assert solution.rms_slope == pytest.approx(np.sqrt(4 / 6))


def test_cells_without_neighbours_have_no_slope():
    grid = Grid.from_domain(4, 4, (0.0, 1.0, 0.0, 1.0))
    gap = np.where(np.indices((4, 4)).sum(0) % 2, np.nan, 0.0)
    solution = solve(ContactProblem(grid, Material.from_contact_modulus(1.0), gap), 0.1)
    assert np.isnan(solution.rms_slope)
    assert solution.perimeter == pytest.approx(8.0)  # eight squares of 0.25


@pytest.mark.parametrize("periodic", [False, True])
def test_contact_without_any_pressure_has_no_area(periodic):
    """In full contact at the least pressure, cells without pressure count."""
    grid = Grid.from_domain(12, 10, (0, 1, 0, 1))
    rough = np.random.default_rng(0).normal(size=grid.shape) * 1e-3
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1e5), rough, periodic)) as solver:
        for solution in (solver.solve(load=0), solver.solve(approach=solver.touching)):
            assert solution.contact_cells == solution.contact.sum() == len(solution.patches().area) == 0
            assert (
                solution.contact_fraction_corrected == solution.contact_fraction == solution.contact_area == 0
            )
        if periodic:
            full = solver.solve(mean_gap=0)
            assert full.pressure[full.contact].min() == 0
            assert full.contact_fraction == full.contact_fraction_corrected == 1


@pytest.mark.parametrize(("holes", "whole"), [(0, "of all"), (100, "of those where contact is possible")])
def test_contact_fraction_is_of_the_admissible_cells(holes, whole):
    """Said also of a contact of so few cells that some holes more or less change next to nothing."""
    gap = np.add.outer(np.arange(32.0) ** 2, np.arange(32.0) ** 2)
    gap.reshape(-1)[gap.size - holes :] = np.nan
    found = solve(ContactProblem(Grid(32, 32, 1.0, 1.0), Material.combined(80000, 0.3), gap), approach=0.1)
    assert found.contact_cells == 1
    assert f"1 cell, {100 / (1024 - holes):.4g}% {whole}\n" in summary(found.attributes, found.grid)
