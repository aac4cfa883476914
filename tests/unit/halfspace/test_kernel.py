"""The contract of kernels: its base class has all that the program uses."""

import re

import numpy as np
import pytest
from processes import TESTS

from app import ContactProblem, Grid, Material, solve
from app.base.errors import InputError
from app.halfspace.kernel import Kernel

COATED = Material.coated((420e3, 105e3), (0.3, 0.3), 0.02)
BONDED = Material.layer(10.0, 0.4, 0.3)
KERNELS = [material.kernel for material in (Material.isotropic(210e3, 0.3), COATED, BONDED)]


def test_base_class_declares_what_the_program_uses():
    used = set()
    for path in (TESTS.parent / "app").rglob("*.py"):
        if "gauss_seidel" not in path.parts:  # kernels of sweeps
            text = re.sub(r"^ *from .*|`.*?`", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
            used |= set(re.findall(r"(?<![_.]box\.)\bkernel\.([a-z]\w*)", text))
    declared = {*dir(Kernel), *vars(Kernel(1.0))}
    assert {"eigenvalues", "coefficients", "middle_displacement"} <= used
    assert used <= declared


@pytest.mark.parametrize("kernel", KERNELS)
def test_defaults_agree_with_the_kernels_own_laws(kernel):
    """Each method that a kernel overrides for speed or accuracy."""
    free, periodic = Grid(24, 20, 0.05, 0.05), Grid(24, 20, 0.05, 0.05, periodic=True)
    x, y = np.arange(13), np.arange(11)
    values = kernel.eigenvalues(periodic, x, y)
    np.testing.assert_allclose(values, Kernel.eigenvalues(kernel, periodic, x, y), rtol=1e-13)
    values = kernel.coefficients(free, y, 13)
    default = Kernel.coefficients(kernel, free, y, 13)
    np.testing.assert_allclose(values, default, rtol=0, atol=1e-12 * values.max())
    assert Kernel.smallest_eigenvalue(kernel, periodic) <= kernel.smallest_eigenvalue(periodic) * (1 + 1e-12)
    assert Kernel.largest_eigenvalue(kernel, periodic) >= kernel.largest_eigenvalue(periodic) * (1 - 1e-12)
    values = kernel.scale_sampled(np.ones((4, 3)), free, np.arange(1.0, 5), np.arange(1.0, 4))
    default = Kernel.scale_sampled(kernel, np.ones((4, 3)), free, np.arange(1.0, 5), np.arange(1.0, 4))
    np.testing.assert_allclose(values, default, rtol=0.02)


class Graded(Kernel):
    """Half-space with a modulus that grows or falls like a power of the depth; on periodic patches only."""

    power, length = 0.3, 1.0

    @property
    def parameters(self):
        return self.compliance, self.length

    def in_units(self, length):
        graded = Graded(1.0)
        graded.length = self.length / length
        return graded

    def wave_compliance(self, qx, qy=0.0):
        return self.compliance * (np.hypot(qx, qy) * self.length) ** -self.power


def test_waves_on_a_graded_half_space():
    """In full contact the pressure is a mean and the wave that flattens the surface."""
    kernel, q, height = Graded(1e-5), 2 * np.pi * np.array([2.0, 1.0]), 1e-3
    material, grid = Material.from_kernel(kernel), Grid.from_domain(32, 32, (0, 1, 0, 1))
    wave = np.cos(q[0] * grid.x()) * np.cos(q[1] * grid.y()[:, None])
    expected = 600 + height * np.hypot(*q) / (2 * np.pi * kernel.wave_compliance(*q)) * wave
    assert expected.min() > 0
    solution = solve(ContactProblem(grid, material, -height * wave, periodic=True), mean_pressure=600)
    np.testing.assert_allclose(solution.pressure, expected, rtol=1e-6)
    for load in (2.0, 60.0):
        touching = solve(ContactProblem(grid, material, -height * wave, periodic=True), load=load)
        assert touching.converged and not touching.fallbacks and 0 < touching.contact_fraction < 1
    with pytest.raises(InputError, match="^periodic: must be True with the kernel Graded, which has no"):
        solve(ContactProblem(grid, material, -height * wave), load=1.0)


def test_kernels_with_equal_parameters_are_equal():
    again = Material.coated((420e3, 105e3), (0.3, 0.3), 0.02).kernel
    assert again == KERNELS[1] and hash(again) == hash(KERNELS[1]) and len({*KERNELS, again}) == 3


@pytest.mark.parametrize("name", ["parameters", "in_units", "wave_compliance", "unit_coefficients"])
def test_what_a_subclass_must_define_is_named(name):
    class Unfinished(Kernel):
        pass

    with pytest.raises(NotImplementedError, match=f"Unfinished.{name}"):
        value = getattr(Unfinished(1.0), name)
        value(*[None] * (value.__code__.co_argcount - 1))
