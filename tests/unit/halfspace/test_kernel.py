"""The contract of kernels: its base class has all that the program uses."""

import re

import numpy as np
import pytest
from processes import TESTS

from app import Grid, Material
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
