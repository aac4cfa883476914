"""Commands with a load centre, moments or a tilt."""

import csv

import numpy as np
import pytest

from app.cli.report import numbers_section
from app.io.result import read_result

BALL = (
    "-problem sphere -sphere_radius 20 -grid 32 -domain -1,1,-1,1 -young 210e3,210e3 -poisson 0.3,0.3".split()
)


def test_a_centre_moments_and_a_tilt_are_options(cli_here, tmp_path):
    file = tmp_path / "tilted.h5"
    done = cli_here(*BALL, "-load", 600, "-load_centre", "0.125,-0.0625", "-stiffness", "-output", file)
    assert done.returncode == 0, done.stderr
    assert "tilt 0.00625, -0.003125; moments 75, -37.5 N mm" in done.stdout
    result = read_result(file)
    facts = result.attributes
    assert facts["tilt_x"] == pytest.approx(0.00625, rel=1e-4)
    stiffness = np.reshape(facts["tilt_stiffness"], (3, 3))
    assert stiffness[0, 0] == pytest.approx(facts["stiffness"], rel=1e-6)
    moments = f"{facts['moment_x']},{facts['moment_y']}"
    for more in (("-moment", moments), ("-tilt", f"{facts['tilt_x']},{facts['tilt_y']}")):
        again = tmp_path / "again.h5"
        assert cli_here(*BALL, "-load", 600, *more, "-output", again).returncode == 0
        np.testing.assert_allclose(
            read_result(again).pressure, result.pressure, atol=1e-4 * facts["max_pressure"]
        )
    assert "tilt in x" in str(numbers_section(result))


def test_a_tilt_on_a_patch_that_repeats_has_a_stiffness(cli_here, tmp_path):
    file = tmp_path / "tilted.h5"
    cylinder = (
        "-problem cylinder -cylinder_radius 20 -grid 32 -domain -1,1,-1,1 -contact_modulus 115e3".split()
    )
    done = cli_here(
        *cylinder, "-periodic", "y", "-load", 600, "-tilt", "1e-3,0", "-stiffness", "-output", file
    )
    assert done.returncode == 0, done.stderr
    facts = read_result(file).attributes
    assert facts["stiffness"] > 0 and "tilt_stiffness" not in facts


def test_a_path_has_one_centre(cli_here, tmp_path):
    table = tmp_path / "path.csv"
    done = cli_here(*BALL, "-load_path", "100,400", "-load_centre", "0.125,0", "-path_csv", table)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(table.open()))
    for row in rows:
        assert float(row["pressure_centre_x"]) == pytest.approx(0.125, abs=1e-9)
        assert float(row["tilt_x"]) == pytest.approx(0.125 / 20, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-load", 1, "-load_centre", "2,0"), "must be inside the convex hull"),
        (("-load", 1, "-tilt", "0.1"), "-tilt"),
        (("-approach", 0.001, "-moment", "0,0"), "needs a prescribed load"),
        (("-load", 1, "-tilt", "0,0", "-moment", "0,0"), "exactly one is allowed"),
        (("-load_path", "1,2", "-load_centre", "2,0"), "must be inside the convex hull"),
    ],
)
def test_bad_input_is_one_line(cli_here, options, message):
    done = cli_here(*BALL, *options)
    assert done.returncode == 2
    assert message in done.stderr and done.stderr.count("\n") == 1
