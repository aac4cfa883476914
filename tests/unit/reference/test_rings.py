"""Hertz's contact with a hardness, on rings."""

import itertools
import math

import numpy as np
import pytest

from app.base.errors import InputError
from app.reference import CappedSphere, Sphere
from app.reference.rings import solve_box

HERTZ = Sphere(10.0, 1e3, 0.01)


def capped(share, rings=100):
    return CappedSphere(10.0, 1e3, share * HERTZ.max_pressure, 0.01, rings)


def test_without_a_hardness_rings_are_hertz():
    c = capped(math.inf)
    assert c.load == pytest.approx(HERTZ.load, rel=1e-4)
    assert c.plastic_area == c.plastic_volume == 0
    inside = c.r < 0.9 * HERTZ.a
    np.testing.assert_allclose(c.ring_pressure[inside], HERTZ.pressure(c.r, 0)[inside], rtol=2e-3)
    np.testing.assert_array_equal(capped(1.1).ring_pressure, c.ring_pressure)


@pytest.mark.parametrize("share", [0.9, 0.5])
def test_rings_converge(share):
    coarse, fine = capped(share), capped(share, 400)
    for name, most in {"load": 1e-4, "plastic_volume": 1e-3, "max_plastic_depth": 1e-3}.items():
        assert getattr(coarse, name) == pytest.approx(getattr(fine, name), rel=most), name
    assert fine.ring_pressure.max() == fine.hardness == fine.pressure(0.0, 0.0)
    assert 0 < fine.plastic_area < fine.contact_area


def test_soft_spheres_touch_where_they_overlap():
    """The limit is the bearing area, 2 pi R d, at the pressure H."""
    c = capped(1e-4)
    area = 2 * math.pi * 10.0 * 0.01
    assert (c.contact_area, c.plastic_area) == pytest.approx((area, area), rel=0.03)
    assert c.load == pytest.approx(c.hardness * c.contact_area, rel=1e-12)


def test_box_solver_agrees_with_brute_force():
    rng = np.random.default_rng(0)
    for _ in range(40):
        b = rng.normal(size=(4, 4))
        matrix, h = b @ b.T + 2 * np.eye(4), rng.normal(size=4) * 3
        upper = rng.choice([0.1, 0.5, np.inf], 4)
        solutions = []
        for sets in itertools.product((0, 1, 2), repeat=4):
            sets = np.array(sets)
            c, p = sets == 1, np.where(sets == 2, upper, 0)
            if np.isinf(p).any():
                continue
            p[c] = np.linalg.solve(matrix[np.ix_(c, c)], -(h + matrix @ p)[c])
            e = h + matrix @ p
            if (
                (e[sets == 0] >= 0).all()
                and (e[sets == 2] <= 0).all()
                and (p >= 0).all()
                and (p <= upper).all()
            ):
                solutions.append(p)
        np.testing.assert_allclose(solve_box(matrix, h, upper), solutions[0], atol=1e-12)


@pytest.mark.parametrize("bad", [{"hardness": 0}, {"approach": -1.0}, {"radius": np.inf}])
def test_wrong_numbers_are_refused(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        CappedSphere(**({"radius": 1.0, "e_star": 1.0, "hardness": 1.0, "approach": 1.0} | bad))
