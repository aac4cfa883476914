"""docs/gallery: its scripts run, are short, and make the pictures of the page."""

import ast
import runpy
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from documents import ROOT

GALLERY = ROOT / "docs" / "gallery"
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
SCRIPTS = sorted(GALLERY.glob("*.py"))
MAX_LINES, MAX_BYTES = 60, 100_000  # of code; of a picture
each_script = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)


@each_script
def test_script_is_short_and_on_the_page_with_a_small_picture(script):
    text = script.read_text(encoding="utf-8")
    document = ast.parse(text).body[0]
    code = [line for line in text.splitlines()[document.end_lineno :] if line.strip() and line[0] != "#"]
    assert len(code) < MAX_LINES
    assert f"(gallery/{script.name})" in PAGE and f"(gallery/{script.stem}.png)" in PAGE
    assert script.with_suffix(".png").stat().st_size < MAX_BYTES


def test_every_picture_has_its_script():
    assert {path.stem for path in GALLERY.glob("*.png")} == {path.stem for path in SCRIPTS}


def ball_on_flat(names):
    assert names["solution"].max_pressure == pytest.approx(names["exact"].max_pressure, rel=1e-3)


def crowned_roller(names):
    along, line = names["along"], names["line"]  # of the last roller
    assert along[len(along) // 2] == pytest.approx(line.max_pressure, rel=5e-3)


def tilted_roller(names):
    """A load off centre tilts the roller as much as moved its centre; the crown allows some minutes."""
    assert names["balanced"].tilt_y / names["minute"] == pytest.approx(names["angles"][3], rel=1e-3)
    peaks = [solution.max_pressure / names["line"].max_pressure for solution in names["turned"]]
    assert peaks[0] < 1.1 and peaks[2] < 1.2 and peaks[-1] > 2


def optimal_crown(names):
    largest = {name: solution.max_pressure for name, solution in names["solutions"].items()}
    assert largest["best"] < 1.05 * names["line"].max_pressure < 0.7 * largest["arc of 1.5 m"]


def contact_resistance(names):
    """It falls with the load as that of spots."""
    assert names["power"] == pytest.approx(-1, abs=0.05)
    assert (names["resistance"] < names["cluster"]).all()


def coating_thickness(names):
    """Thick coatings protect the substrate, thin hard ones do not."""
    plain = names["plain"].von_mises / names["p0"]
    assert plain == pytest.approx(0.620, rel=5e-3)
    for ratio, rows in names["table"].items():
        substrate, _, shear = rows.T
        assert substrate[0] == pytest.approx(plain, rel=0.05) and substrate[-1] < 0.4 * plain
        assert (substrate[:4].max() > plain) == (ratio > 1)
        assert 0 < shear.argmax() < len(shear) - 1


def creep(names):
    """The contact of a ball grows as the creep function to the power 2/3."""
    growth = names["area"] / names["area"][0]
    np.testing.assert_allclose(growth, names["creep"] ** (2 / 3), rtol=0.02)
    assert (np.diff(names["fraction"]) >= 0).all()


def contact_law(names):
    """The bars and the faces carry one force, and add up to the displacement."""
    force, closing = names["forces"][-1], names["closing"]
    assert names["law"].at(indentation=closing)["load"] == pytest.approx(force)
    bars = 2 * names["length"] / names["young"] * force
    assert closing + bars == pytest.approx(names["push"], rel=1e-9)
    with names["ContactSolver"](names["problem"]) as solver:
        assert solver.solve(load=force).indentation == pytest.approx(closing, rel=1e-3)


def indentation(names):
    """The plate unloads with the stiffness of a circle."""
    loaded, table = names["loaded"], names["table"]
    assert loaded.unloading_stiffness == pytest.approx(names["oliver_pharr"], rel=0.01)
    assert names["unloaded"].load == 0 < names["unloaded"].indentation < loaded.indentation
    assert table["max_pressure"].max() == 2000


def wheel_on_rail(names):
    """It is stressed most below the surface."""
    assert names["hottest"].depth > 1 and names["solution"].notes == ()


def measured_surface(names):
    assert names["rough"].contact_area < 0.8 * names["smooth"].contact_area


def rough_surfaces(names):
    """The area is between the theories at light loads."""
    table = names["table"]
    share = table["contact_fraction_corrected"]
    light = share < 0.05
    assert (table["persson_fraction"][light] < share[light]).all()
    assert (share[light] < table["bush_gibson_thomas_fraction"][light]).all()


def area_load(names):
    """Kappa is that of the literature, and the corrected area of a coarse grid is right to a few percent."""
    coarse, finest = names["tables"][128], names["tables"][512]
    assert 2.2 < names["kappa"] < np.sqrt(2 * np.pi)
    assert (finest["persson_fraction"] < finest["contact_fraction_corrected"]).all()
    np.testing.assert_allclose(
        coarse["contact_fraction_corrected"], finest["contact_fraction_corrected"], rtol=0.04
    )
    assert (coarse["contact_fraction"][:6] > 1.15 * finest["contact_fraction_corrected"][:6]).all()


def data_set(names):
    """The files have all samples and their units, and the maps agree with the numbers."""
    import pandas
    import xarray

    assert names["table"].converged and len(names["frame"]) == 4
    stored = pandas.read_parquet("data_set.parquet")
    pandas.testing.assert_frame_equal(stored, names["frame"])
    assert names["parquet"].read_schema("data_set.parquet").field("approach").metadata == {b"units": b"mm"}
    with xarray.open_dataset("data_set.nc", engine="h5netcdf") as data:
        found = [data[name].attrs["units"] for name in ("contact", "load", "x", "rms_slope")]
        assert found == ["1", "N", "mm", "1"]
        fraction = data.contact.mean(["x", "y"]).values
    np.testing.assert_allclose(fraction, stored["contact_fraction"], rtol=1e-12)


def leakage(names):
    """The leakage falls, and the gap closes near the percolation threshold of rough surfaces."""
    rate, is_open = names["rate"], names["is_open"]
    assert (np.diff(rate[is_open]) < 0).all() and not rate[~is_open].any()
    assert names["low"] < names["high"] < 1.02 * names["low"]
    assert 0.3 < names["middle"].contact_fraction < 0.5  # 0.42 of large samples


def wear(names):
    """Archard's volume."""
    path = names["step"] * names["path"]
    volume = names["worn"].sum() * names["grid"].cell_area
    assert volume == pytest.approx(names["k"] * names["load"] * path, rel=1e-9)


ARGUMENTS = {"data_set": ["4"]}  # of scripts that take as many minutes as one likes
CHECKS = {"two_bodies": ball_on_flat}
for check in (
    *(ball_on_flat, crowned_roller, optimal_crown, contact_resistance, coating_thickness, contact_law, creep),
    *(indentation, wheel_on_rail, measured_surface, rough_surfaces, leakage, tilted_roller, wear),
    *(area_load, data_set),
):
    CHECKS[check.__name__] = check


@each_script
def test_script_has_the_numbers_of_theory_and_makes_its_picture(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(script), *ARGUMENTS.get(script.stem, ())])
    plt.switch_backend("agg")
    CHECKS[script.stem](runpy.run_path(str(script), run_name="__main__"))
    assert (tmp_path / f"{script.stem}.png").is_file()
    plt.close("all")
