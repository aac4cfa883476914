"""Coatings on the command line."""

import pytest

PATCH = "-problem", "sphere", "-sphere_radius", 10, "-grid", 16, "-domain", "-1,1,-1,1", "-load", 1
COATING = "-coating_young", 3, "-coating_poisson", 0.3, "-coating_thickness", 0.1
BODIES = "-young", "inf,inf", "-poisson", "0,0"


def test_coating_is_summarised(cli_here):
    done = cli_here(*PATCH, "-periodic", *BODIES, *COATING)
    assert done.returncode == 0
    assert "coating of E 3 N/mm2, nu 0.3, thickness 0.1 mm on E inf" in done.stdout


@pytest.mark.parametrize("options, text", [
    (("-periodic", *BODIES, *COATING[2:]), "-coating_young is missing"),
    (("-periodic", *COATING), "-young is missing"),
    (("-periodic", "-contact_modulus", 5, *COATING), "-young is missing"),
    (("-periodic", *BODIES, *COATING, "-stiffness", "-resistivity", "1,1"), "coated bodies"),
])  # fmt: skip
def test_incomplete_coatings_are_refused(cli_here, options, text):
    done = cli_here(*PATCH, *options)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ") and text in done.stderr and done.stderr.count("\n") == 1
