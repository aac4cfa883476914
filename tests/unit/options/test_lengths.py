"""Lengths with units, wherever a length is read."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from app.api.fitted_grid import fit_grid
from app.base.errors import InputError
from app.base.units import UNITS, to_length, to_millimetres
from app.cli.problem_options import PROBLEM_OPTIONS
from app.contact.loading_input import validate_number
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.options.option_table import Option, OptionReader, length, lengths, positive
from app.problems.random_surfaces import SelfAffineSurface
from app.problems.roller import Roller
from app.problems.shapes import Cylinder, FlatPunch, Paraboloid, Sphere

LENGTHS = [option for option in PROBLEM_OPTIONS if "[mm]" in option.meaning]
SAMPLES = {
    "domain": "-{0},{0},-{0},{0}",
    "body1_radii": "{0},-{0}",
    "body2_radii": "inf,{0}",
    "approach_path": "0:{0}:3",
    "load_centre": "{0},-{0}",
}


def read(name, text):
    return OptionReader(PROBLEM_OPTIONS, {name: text})[name]


@pytest.mark.parametrize("name", [option.name for option in LENGTHS])
def test_options_of_length_accept_units(name):
    sample = SAMPLES.get(name, "{0}")
    expected = read(name, sample.format("0.003"))
    for text in ("3um", "3 um", "3µm", "3e-6m", "3000nm", "3.0 µm"):
        assert read(name, sample.format(text)) == expected  # to the last bit
    assert read(name, sample.format("2in")) == read(name, sample.format("50.8"))
    for text in ("2 furlongs", "2N", "2MM", "2umm"):
        with pytest.raises(
            InputError, match=rf"-{name} .*must be a number .mm., or have a unit of m, cm, mm"
        ) as error:
            read(name, sample.format(text))
        assert "\n" not in str(error.value)


def test_every_option_of_length_is_here():
    names = {option.name for option in LENGTHS}
    assert {"domain", "approach", "mean_gap", "approach_path", "mean_gap_path", "coating_thickness"} <= names
    assert {"sphere_radius", "hertz_rx", "body1_radii", "roller_length", "punch_diameter"} <= names
    assert {"surface_sigma", "surface_rolloff", "surface_cutoff", "surface_s_filter"} <= names


@pytest.mark.parametrize("name", ["load", "contact_modulus", "hardness", "grid", "surface_hurst"])
def test_other_options_have_no_units_of_length(name):
    with pytest.raises(InputError, match=f"-{name} 1um: must be"):
        read(name, "1um")


def test_options_of_user_defined_problems_accept_units():
    for kind in length, lengths(positive):
        assert (
            OptionReader([Option("bump", kind, 1.0, "height of the bump")], {"bump": "5 nm"})["bump"] == 5e-6
        )
    with pytest.raises(InputError):
        OptionReader([Option("bump", positive, 1.0, "text without [mm]")], {"bump": "5 nm"})["bump"]


def test_lengths_have_units_all_or_none():
    for text in ("-1,1,-1,1um", "1:2um:5"):
        with pytest.raises(ValueError, match="all have units, or none"):
            to_millimetres(text)
    assert to_millimetres("0,1um,0,2um") == "0,0.001,0,0.002"
    assert to_millimetres("1,2.50,3") == "1,2.50,3"
    with pytest.raises(InputError, match="-approach 1e999999m: must be"):
        read("approach", "1e999999m")


@pytest.mark.parametrize("unit", UNITS)
def test_python_arguments_accept_units(unit):
    text = f"3 {unit}"
    length = to_length("length", text)
    assert length == pytest.approx(3 * UNITS[unit], rel=1e-15)
    assert Material.coated((2e5, 1e5), (0.3, 0.3), text).coatings[0].thickness == length
    assert Grid.from_domain(4, 4, (f"-{text}", text, f"-{text}", text)).domain == (
        -length,
        length,
        -length,
        length,
    )


SHAPES = {
    "sphere": lambda length: Sphere(length).rx,
    "paraboloid": lambda length: Paraboloid(length, length).ry,
    "two bodies": lambda length: 2 * Paraboloid.between(length, (length, length)).rx,
    "cylinder": lambda length: Cylinder(1, length=length).length,
    "punch": lambda length: FlatPunch(length).diameter,
    "roller": lambda length: Roller(length, 1e5, "arc", end_chamfer=0, crown_radius=length).crown_radius,
    "chamfer": lambda length: Roller(1, 1e5, end_chamfer=length).end_chamfer,
    "rough": lambda length: SelfAffineSurface(0.8, length, length, (9, 9), 1, rms_slope=1).rolloff_wavelength,
    "grid": lambda length: Grid(8, 8, length, length).dx,
    "corner": lambda length: Grid(8, 8, 1, 1, length, length).y0,
    "approach": lambda length: validate_number("approach", length),
}


@pytest.mark.parametrize("name", SHAPES)
def test_lengths_of_shapes_and_grids_are_numbers_or_texts_with_units(name):
    for given in ("3 mm", "3000um", Decimal(3), Fraction(3), np.float32(3), 3):
        assert SHAPES[name](given) == 3
    for wrong in ("3", "3 furlongs", "3 mm,4 mm", "", True, None, b"3"):
        with pytest.raises(InputError, match="must be"):
            SHAPES[name](wrong)


def test_a_fitted_grid_has_the_same_patch_for_an_approach_with_a_unit():
    steel = Material.isotropic(210e3, 0.3)
    assert fit_grid(Sphere("10 mm"), steel, approach="2 um") == fit_grid(Sphere(10), steel, approach=0.002)


def test_a_prescribed_approach_may_have_a_unit():
    assert validate_number("approach", "2 um") == validate_number("mean_gap", "2e-6 m") == 0.002
    for kind, text in (
        ("approach", "2 furlongs"),
        ("approach", "0.002"),
        ("load", "2um"),
        ("approach", "inf m"),
    ):
        with pytest.raises(InputError, match=f"^{kind}[ :].*must be a number"):
            validate_number(kind, text)


def test_wrong_units_of_python_arguments():
    for make in (
        lambda: Material.coated((2e5, 1e5), (0.3, 0.3), "2 furlongs"),
        lambda: Material.coated((2e5, 1e5), (0.3, 0.3), "thick"),
        lambda: Material.coated((2e5, 1e5), (0.3, 0.3), "2"),
    ):
        with pytest.raises(
            InputError, match="thickness '.*': must be a number .mm., or have a unit of m, cm"
        ):
            make()
