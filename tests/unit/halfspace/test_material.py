"""Elastic constants of two bodies."""

import numpy as np
import pytest
from mpi4py import MPI

from app import InputError, Material
from app.cli.geometry import make_problem
from app.cli.option_sources import OptionSource, ParsedOptions
from app.cli.problem_options import PROBLEM_OPTIONS, resolve_alternatives
from app.options.option_table import OptionReader


def test_material():
    # Steel on steel, Sec. 5.1: 2/G = 1/G1 + 1/G2, 1/E* = (1 - nu)/G
    steel = Material.combined(82000.0, 0.28)
    assert steel.compliance == pytest.approx(0.72 / (np.pi * 82000), rel=1e-15)
    assert steel.contact_modulus == pytest.approx(82000 / 0.72, rel=1e-15)
    expected = {"shear_modulus": 82000, "poisson_ratio": 0.28, "contact_modulus": steel.contact_modulus}
    assert steel.describe() == expected
    alike = Material.from_contact_modulus(steel.contact_modulus)
    assert alike.compliance == pytest.approx(steel.compliance, rel=1e-15)
    assert alike.describe() == {"contact_modulus": steel.contact_modulus}
    with pytest.raises(ValueError, match="contact modulus -1: must be positive"):
        Material.from_contact_modulus(-1.0)
    for poisson_ratio in (0, 0.5):
        Material.combined(1.0, poisson_ratio)


@pytest.mark.parametrize("shear_modulus", [0, -1.0, np.inf, np.nan, 1e-320])
def test_shear_modulus_must_be_positive_and_finite(shear_modulus):
    with pytest.raises(ValueError, match="shear modulus"):
        Material.combined(shear_modulus, 0.3)


@pytest.mark.parametrize("poisson_ratio", [-1e-9, 0.5 + 1e-9, np.nan, np.inf])
def test_poisson_ratio_must_be_from_0_to_one_half(poisson_ratio):
    with pytest.raises(ValueError, match="Poisson ratio"):
        Material.combined(1.0, poisson_ratio)


def made(**texts):
    given = {"problem": "sphere", "sphere_radius": "1", "grid": "4", "domain": "0,1,0,1", **texts}
    return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)[0].material


@pytest.mark.parametrize("young", [(210e3, 3e3), (70e3, np.inf), (np.inf, 1.0)])
def test_contact_modulus_combines_both_bodies(young):
    poisson = (0.3, 0.35)
    expected = 1 / sum((1 - nu**2) / modulus for nu, modulus in zip(poisson, young, strict=True))
    assert Material.pair(young, poisson).contact_modulus == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"resistivity": (0, 0)}, r"resistivity 0,0: must be .* at least 0, and one above 0 \[ohm m\]"),
        ({"resistivity": -1}, "resistivity -1: must be"),
        ({"resistivity": ("copper", "brass")}, "resistivity copper,brass: must be"),
        ({"thermal_conductivity": (0, 1)}, r"thermal_conductivity .*: must be .* above 0, .* \[W/\(m K\)\]"),
        ({"thermal_conductivity": np.inf}, "thermal_conductivity inf: must be .* one finite"),
    ],
)
def test_invalid_constants_of_conductance_are_refused(constants, message):
    with pytest.raises(InputError, match=f"^{message}"):
        Material.isotropic(210e3, 0.3).conducting(**constants)


def test_conducting_material_is_a_copy_that_fits_the_same_solver():
    steel = Material.isotropic(210e3, 0.3)
    both = steel.conducting(1e-7).conducting(thermal_conductivity=(45, np.inf))
    assert both == steel and steel.resistivity is None
    assert both.describe() == steel.describe() | {
        "resistivity": [1e-7, 1e-7], "thermal_conductivity": [45.0, np.inf],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("numbers", "names"), [((210e3, 0.3), {}), ((), {"E": 210e3, "nu": 0.3}), ((), {"shear_modulus": 82e3})]
)
def test_material_requires_both_keywords(numbers, names):
    with pytest.raises(TypeError):
        Material(*numbers, **names)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({}, "-contact_modulus is missing: .* -young and -poisson, or -shear_modulus and -poisson_ratio"),
        ({"young": "1,2"}, "-poisson is missing"),
        ({"young": "210e3", "poisson": "0.3,0.3"}, "-young 210e3: must be E1,E2"),
        ({"young": "1,2", "poisson": "0.3,0.6"}, "-poisson 0.3,0.6: must be"),
        ({"young": "inf,inf", "poisson": "0,0"}, "one body at least must be elastic"),
    ],
)
def test_invalid_material_options_are_refused(texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        made(**texts)


def test_last_option_source_decides_alternatives():
    texts = {"shear_modulus": "1", "poisson_ratio": "0.3", "young": "1,2", "poisson": "0,0"}
    pairs = list(texts.items())
    file, line = (
        OptionSource(where, dict(part)) for where, part in (("in a.opts", pairs[:2]), ("", pairs[2:]))
    )
    given = ParsedOptions(dict(texts), [file, line])
    resolve_alternatives(given)
    assert given.texts.keys() == {"young", "poisson"}
    with pytest.raises(InputError, match="both -young and -shear_modulus are given on the command line"):
        resolve_alternatives(ParsedOptions(dict(texts), [OptionSource("on the command line", texts)]))


def test_a_modulus_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="a number"):
        Material.from_contact_modulus("steel")


def test_coated_material_describes_its_bodies():
    material = Material.coated((450e3, 210e3), (0.25, 0.3), 0.002, other=(3e3, 0.35))
    assert material.describe() == {
        "young": [210e3, 3e3], "poisson": [0.3, 0.35],
        "coating_young": 450e3, "coating_poisson": 0.25, "coating_thickness": 0.002,
    }  # fmt: skip
    assert material != Material.coated((450e3, 210e3), (0.25, 0.3), 0.003, other=(3e3, 0.35))
    assert Material.layer(5.0, 0.4, 1.0).describe()["young"] == [np.inf, np.inf]


def test_both_bodies_may_be_coated():
    film, lining = ((450e3, 210e3), (0.25, 0.3), 0.002), ((5.0, np.inf), (0.5, 0.0), 3.0)
    material = Material.coated(*film, other=Material.coated(*lining))
    assert material.describe() == {
        "young": [210e3, np.inf], "poisson": [0.3, 0.0],
        "coating_young": [450e3, 5.0], "coating_poisson": [0.25, 0.5], "coating_thickness": [0.002, 3.0],
    }  # fmt: skip
    options = {
        "young": "210e3,inf",
        "poisson": "0.3,0",
        "coating_young": "450e3,5",
        "coating_poisson": "0.25,0.5",
    }
    assert made(**options, coating_thickness="2e-3,3") == material
    assert made(**options | {"young": "210e3,3e3"}, coating_thickness="2e-3,3") != material
    with pytest.raises(InputError, match="one number each, or two each"):
        made(**options, coating_thickness="2e-3")
    for other in (material, Material.isotropic(1.0, 0.3), Material.layer(5.0, 0.4, 1.0, other=(1.0, 0.3))):
        with pytest.raises(InputError, match="other: must be E, nu"):
            Material.coated(*film, other=other)


@pytest.mark.parametrize("arguments, text", [
    (((1, 2), (0.3, 0.3), 0), "thickness 0: must be positive"),
    (((np.inf, 2), (0.3, 0.3), 1), "of the coating: must be finite"),
    (((1, 2), (0.3, 0.6), 1), "must be two numbers from 0 to 0.5"),
    ((1, 0.3, 1), "coated: must be"),
    (((1, 2), (0.3, 0.3), 1, 5), "other: must be E, nu"),
])  # fmt: skip
def test_impossible_coatings_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        Material.coated(*arguments)


def test_conductance_of_a_coated_body_is_refused():
    layer = Material.layer(5.0, 0.4, 1.0)
    assert layer.conducting() == layer
    with pytest.raises(InputError, match="^resistivity, thermal_conductivity: not for coated bodies"):
        layer.conducting(resistivity=1.0)


@pytest.mark.parametrize(
    "made",
    [
        Material.isotropic(210e3, 0.3),
        Material.pair((210e3, np.inf), (0.3, 0.0)).conducting((1.7e-8, 0.0)),
        Material.from_contact_modulus(1e5).conducting(1e-7, (50.0, np.inf)),
        Material.combined(8e4, 0.3),
    ],
)
def test_a_material_is_printed_as_it_was_given(made):
    copy = eval(repr(made), {"Material": Material, "inf": np.inf})
    assert copy.describe() == made.describe()


def test_materials_that_differ_are_printed_differently():
    numbers = (400e3, 210e3), (0.25, 0.3), 2e-3
    made = (
        Material.coated(*numbers),
        Material.coated(*numbers, other=(70e3, 0.33)),
        Material.isotropic(400e3, 0.25),
    )
    assert len({repr(material) for material in made}) == 3
    assert (
        "coating_thickness=0.002" in repr(made[0]) and "inf" in repr(made[0]) and "inf" not in repr(made[1])
    )
