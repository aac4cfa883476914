"""Two bodies' elastic constants become one."""

import numpy as np
import pytest
from mpi4py import MPI

from app.base.errors import InputError
from app.cli.option_sources import OptionSource, ParsedOptions
from app.cli.problem_options import PROBLEM_OPTIONS, make_problem, resolve_alternatives
from app.halfspace.influence import Material
from app.options.option_table import OptionReader


def made(**texts):
    given = {"problem": "sphere", "sphere_radius": "1", "grid": "4", "domain": "0,1,0,1", **texts}
    return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)[0].material


@pytest.mark.parametrize("young", [(210e3, 3e3), (70e3, np.inf), (np.inf, 1.0)])
def test_contact_modulus_is_that_of_both_bodies(young):
    poisson = (0.3, 0.35)
    expected = 1 / sum((1 - nu**2) / modulus for nu, modulus in zip(poisson, young, strict=True))
    assert Material.pair(young, poisson).contact_modulus == pytest.approx(expected, rel=1e-14)


def test_steel_on_polymer():
    material = made(young="210e3,3e3", poisson="0.3,0.35")
    assert material.contact_modulus == pytest.approx(3369, abs=0.5)
    facts = material.describe()
    assert facts["young"] == [210e3, 3e3] and facts["poisson"] == [0.3, 0.35]
    assert facts["shear_modulus"] / (1 - facts["poisson_ratio"]) == pytest.approx(facts["contact_modulus"])


def test_equal_bodies_are_the_paper_s_pair():
    pair = Material.pair((2.56 * 80e3,) * 2, (0.28,) * 2)
    assert (pair.shear_modulus, pair.poisson_ratio) == pytest.approx((80e3, 0.28), rel=1e-14)


def test_equal_bodies_have_half_the_contact_modulus_of_one_on_a_rigid_one():
    steel = Material.isotropic(210e3, 0.3)
    assert steel.contact_modulus == pytest.approx(210e3 / (2 * (1 - 0.3**2)), rel=1e-14)
    assert steel.describe() == Material.pair((210e3, 210e3), (0.3, 0.3)).describe()


@pytest.mark.parametrize(
    ("numbers", "names", "call"),
    [
        ((210e3, 0.3), {}, r"Material.isotropic\(210000.0, 0.3\)"),
        ((82e3,), {"poisson_ratio": 0.28}, r"Material.combined\(G, nu\)"),
        ((), {"shear_modulus": 82e3}, r"Material.combined\(G, nu\)"),
    ],
)
def test_a_material_takes_named_numbers_only_and_both(numbers, names, call):
    with pytest.raises(InputError, match=f"takes keywords only.*{call}"):
        Material(*numbers, **names)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({}, "neither -contact_modulus .* -young .* -shear_modulus .*: exactly one of these ways"),
        ({"young": "1,2"}, "-poisson is missing"),
        ({"poisson": "0.3,0.3"}, "-young is missing"),
        ({"young": "210e3", "poisson": "0.3,0.3"}, "-young 210e3: must be E1,E2"),
        ({"young": "1,-2", "poisson": "0.3,0.3"}, "-young 1,-2: must be"),
        ({"young": "1,2", "poisson": "0.3,0.6"}, "-poisson 0.3,0.6: must be"),
        ({"young": "inf,inf", "poisson": "0,0"}, "one body at least must be elastic"),
    ],
)
def test_refused(texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        made(**texts)


def test_the_last_place_decides_and_one_place_gives_one_way():
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
