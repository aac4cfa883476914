"""The judge of periodic benchmarks: what is right passes, and what is wrong in one way is seen in that way."""

import numpy as np
import pytest

from app import ContactProblem, Grid, Material, Sphere, read_result, solve
from app.reference import full_contact_pressure
from benchmarks import bench, periodic
from benchmarks.plain import PlainPeriodicProduct, check_periodic

N = 64


@pytest.fixture
def flattened():
    """Product, pressure in full contact, distance, mean pressure."""
    grid, h, e_star = periodic.surface_grid(N), periodic.distance(N), periodic.MATERIAL.contact_modulus
    mean_pressure = periodic.mean_pressure(periodic.LOADS[-1])
    p = full_contact_pressure(h, grid.dx, grid.dy, e_star, mean_pressure)
    return PlainPeriodicProduct(grid, e_star), p, h, mean_pressure


def test_full_contact_passes(flattened):
    found = check_periodic(*flattened)
    assert max(found.values()) < 1e-12


def test_a_uniform_distance_and_the_approach_do_not_count(flattened):
    product, p, h, mean_pressure = flattened
    assert max(check_periodic(product, p, h + 7, mean_pressure).values()) < 1e-12


def test_what_is_wrong_is_seen(flattened):
    product, p, h, mean_pressure = flattened
    assert check_periodic(product, 1.01 * p, h, mean_pressure)["load_error"] == pytest.approx(0.01)
    uneven = p + 1e-3 * mean_pressure * np.where(np.arange(N) % 2, 1, -1)
    found = check_periodic(product, uneven, h, mean_pressure)
    assert found["residual"] > 1e-6 and found["penetration"] > 1e-6 and found["load_error"] < 1e-12
    torn = p.copy()
    torn[0, 0] = -1e-3 * p.max()
    assert check_periodic(product, torn, h, mean_pressure)["tension"] == pytest.approx(1e-3)
    assert (
        check_periodic(product, np.where(p > p.mean(), p, 0), h, p[p > p.mean()].sum() / p.size)[
            "penetration"
        ]
        > 0.1
    )


def test_surface_is_that_of_the_benchmark():
    h = periodic.distance(N)
    q = 2 * np.pi * np.fft.fftfreq(N, 1 / N)
    spectrum = np.abs(np.fft.fft2(h, norm="forward")) ** 2
    slope = np.sqrt(np.sum(spectrum * (q[:, None] ** 2 + q**2)))
    assert slope == pytest.approx(periodic.SLOPE, rel=1e-12)
    k = np.hypot(q[:, None], q) / (2 * np.pi)
    assert spectrum[k > N / 8 * (1 + 1e-9)].max() < 1e-25
    assert h.min() == 0


def test_hardness_bounds_are_checked():
    grid, e_star = periodic.surface_grid(N), periodic.MATERIAL.contact_modulus
    product, x = PlainPeriodicProduct(grid, e_star), np.arange(N) / N
    wave = np.cos(2 * np.pi * x)[:, None] + np.cos(2 * np.pi * x)
    p = np.clip(1.0 + wave, 0.0, 2.0)  # hardness 2
    e = 1e-5 * np.where(p == 0, 1, np.where(p == 2, -1, 0))

    def found(p, e):
        return check_periodic(product, p, e - product(p), p.mean(), 2.0)

    assert max(found(p, e).values()) < 1e-12
    for wrong in (p == 0, p == 2):
        assert found(p, np.where(wrong, -e, e))["penetration"] > 0.1
    assert found(1.5 * p, e)["tension"] == pytest.approx(1 / 3)
    full = np.full_like(p, 2.0)
    assert max(found(full, -np.abs(wave)).values()) < 1e-12


def test_padded_product_of_a_result_gives_its_displacement(tmp_path):
    grid = Grid.from_domain(24, 16, (-3, 3, -2, 2))
    solve(ContactProblem(grid, Material.combined(82000, 0.28), Sphere(50)), approach=0.02).save(
        tmp_path / "r.h5"
    )
    result = read_result(tmp_path / "r.h5")
    product = bench.padded_product(result)
    np.testing.assert_allclose(product(result.pressure), result.displacement, rtol=1e-10)
