"""The kernel of layered bodies."""

import numpy as np
import pytest

from app import Grid, Material
from app.halfspace.influence import dense_matrix, influence_quadrant

GRIDS = [
    Grid(n, 10, 0.1, dy, periodic=kind) for kind in ("spectral", "love") for n, dy in ((12, 0.1), (9, 0.03))
]


def eigenvalues(material, grid):
    return material.kernel.eigenvalues(grid, np.arange(grid.nx // 2 + 1), np.arange(grid.ny // 2 + 1))


@pytest.mark.parametrize("periodic", ["", "spectral", "love"])
def test_displacements_of_two_layered_bodies_are_added(periodic):
    grid = Grid(9, 7, 0.1, 0.13, periodic=periodic)
    film, lining = Material.coated((3.0, 1.0), (0.2, 0.4), 0.1), Material.layer(2.0, 0.3, 0.4)
    for one, other in ((film, lining), (lining, film), (lining, lining)):
        layers = one.coatings[0], other.coatings[0]
        both = Material.coated(layers[0].young, layers[0].poisson, layers[0].thickness, other=other).kernel
        kernels = both, one.kernel, other.kernel
        together, *each = (dense_matrix(grid, kernel) for kernel in kernels)
        np.testing.assert_allclose(together, sum(each), atol=1e-14 * together[0, 0])
        uniform, *parts = (kernel.uniform_compliance(grid) for kernel in kernels)
        assert uniform == pytest.approx(sum(parts), rel=1e-15)
        longest, *parts = (kernel.middle_displacement((1.0, 0.7)) for kernel in kernels)
        assert longest == pytest.approx(sum(parts), rel=1e-14)


def test_uniform_cells_sum_over_all_waves():
    """The difference from a half-space, whose waves beyond 1 / thickness do not count, by a sum over waves."""
    grid, material = Grid(6, 5, 0.1, 0.2, periodic="love"), Material.coated((1.0, 4.0), (0.3, 0.2), 0.1)
    half_space = Material.pair((1.0, np.inf), (0.3, 0.0))
    found = (eigenvalues(material, grid) - eigenvalues(half_space, grid))[2, 1]
    kx, ky = 2 + 6 * np.arange(-9, 10)[:, None], 1 + 5 * np.arange(-19, 20)
    q = 2 * np.pi * np.hypot(kx / 0.6, ky / 1.0)
    terms = 2 * np.pi * (material.kernel.wave_compliance(q) - half_space.kernel.compliance) / q
    assert found == pytest.approx((terms * np.sinc(kx / 6) * np.sinc(ky / 5)).sum(), rel=1e-12)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize("moduli", [(1.0, 10.0), (10.0, 1.0), (1.0, np.inf)])
@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("thickness", [0.03, 0.3])
def test_eigenvalues_are_within_their_bounds(grid, moduli, nu, thickness):
    kernel = Material.coated(moduli, (nu, 0.2), thickness).kernel
    values = np.sort(np.linalg.eigvalsh(dense_matrix(grid, kernel)))
    assert abs(values[0]) < 1e-12 * values[-1]  # of the constant
    assert kernel.smallest_eigenvalue(grid) <= values[1] * (1 + 1e-12)
    assert values[-1] <= kernel.largest_eigenvalue(grid) * (1 + 1e-3)  # sampled waves


@pytest.mark.parametrize("nu", [0.3, 0.49, 0.5])
@pytest.mark.parametrize("shape", [(16, 16), (20, 6), (30, 1)])
def test_no_eigenvalue_of_a_free_patch_is_below_its_bound(shape, nu):
    """The longest waves on an incompressible layer have the smallest eigenvalues."""
    kernel, grid = Material.layer(1.0, nu, 1.0).kernel, Grid(*shape, 1.0, 1.0)
    assert 0 < kernel.smallest_eigenvalue(grid) <= np.linalg.eigvalsh(dense_matrix(grid, kernel))[0]


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_wide_punch_on_a_thin_layer_compresses_it_uniformly(nu):
    kernel, area = Material.layer(2.0, nu, 1e-4).kernel, 3.0
    assert kernel.punch_stiffness(area) == pytest.approx(area / kernel.layers[0].uniform_compliance, rel=1e-3)
    assert Material.layer(2.0, nu, 1e4).kernel.punch_stiffness(area) == pytest.approx(
        Material.pair((2.0, np.inf), (nu, 0.0)).kernel.punch_stiffness(area), rel=1e-3
    )


@pytest.mark.parametrize(
    "nu, young", [(0.3, (1.0, np.inf)), (0.5, (1.0, np.inf)), (0.3, (10.0, 1.0)), (0.4, (1.0, 3.0))]
)
@pytest.mark.parametrize("cell", [(0.1, 0.2), (1.5, 0.8)])
def test_coefficients_are_integrals_of_the_point_load(nu, young, cell):
    """The sum over q is taken by quadrature in the plane of wave numbers."""
    kernel, (dx, dy) = Material.coated(young, (nu, 0.25), 1.0).kernel, cell
    layer, grid = kernel.layers[0], Grid(6, 6, dx, dy)
    half_space = influence_quadrant(grid, Material.pair((young[0], np.inf), (nu, 0)).kernel)
    q, weights = np.polynomial.legendre.leggauss(400)
    q, weights = 15 * (q + 1), 15 * weights
    angle = (np.arange(400) + 0.5) * np.pi / 800  # of a quarter; the integrand is periodic and even
    qx, qy = q[:, None] * np.cos(angle), q[:, None] * np.sin(angle)
    form = np.sinc(qx * dx / 2 / np.pi) * np.sinc(qy * dy / 2 / np.pi) * dx * dy
    for j, i in ((0, 0), (1, 2), (4, 0)):
        waves = (form * np.cos(qx * i * dx) * np.cos(qy * j * dy)).mean(axis=1)
        excess = layer.plane_compliance * np.sum(weights * (layer.ratio(q) - 1) * waves)
        found = influence_quadrant(grid, kernel)[j, i]
        assert found == pytest.approx(half_space[j, i] + excess, abs=3e-8 * half_space[0, 0])


@pytest.mark.parametrize(
    "ratio, nu, cell", [(0.01, 0.3, 1.6), (0.1, 0.5, 1.0), (0.1, 0.3, 1.0), (2.0, 0.3, 0.5)]
)
def test_negative_coefficients_are_found_wherever_they_are(ratio, nu, cell):
    """Cells of 1.6 thicknesses are displaced upwards along the diagonal only."""
    kernel, grid = Material.coated((ratio * (1 + nu), 1.3), (nu, 0.3), 1.0).kernel, Grid(12, 12, cell, cell)
    coefficients = kernel.coefficients(grid, np.arange(12), 12)
    assert kernel.is_positive(grid) == (coefficients.min() >= 0)
