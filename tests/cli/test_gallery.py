"""docs/gallery: its scripts run, are short, and make the pictures of the page."""

import ast
import runpy

import matplotlib.pyplot as plt
import numpy as np
import pytest
from documents import ROOT

GALLERY = ROOT / "docs" / "gallery"
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
SCRIPTS = sorted(GALLERY.glob("*.py"))
MAX_LINES, MAX_BYTES = 60, 100_000  # of code; of a picture
each_script = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)


@pytest.fixture
def run_script(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("agg")

    def run(name):
        return runpy.run_path(str(GALLERY / f"{name}.py"))

    yield run
    plt.close("all")


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


def test_ball_has_the_numbers_of_hertz(run_script, tmp_path):
    names = run_script("ball_on_flat")
    assert names["solution"].max_pressure == pytest.approx(names["exact"].max_pressure, rel=1e-3)
    assert (tmp_path / "ball_on_flat.png").is_file()


def test_bodies_at_an_angle_have_the_numbers_of_hertz(run_script, tmp_path):
    names = run_script("two_bodies")
    assert names["solution"].max_pressure == pytest.approx(names["exact"].max_pressure, rel=1e-3)
    assert (tmp_path / "two_bodies.png").is_file()


def test_logarithmic_roller_has_the_pressure_of_line_contact(run_script, tmp_path):
    names = run_script("crowned_roller")
    along, line = names["along"], names["line"]  # of the last roller
    assert along[len(along) // 2] == pytest.approx(line.max_pressure, rel=5e-3)
    assert (tmp_path / "crowned_roller.png").is_file()


def test_the_best_crown_has_almost_the_pressure_of_line_contact(run_script, tmp_path):
    names = run_script("optimal_crown")
    largest = {name: solution.max_pressure for name, solution in names["solutions"].items()}
    assert largest["best"] < 1.05 * names["line"].max_pressure < 0.7 * largest["arc of 1.5 m"]
    assert (tmp_path / "optimal_crown.png").is_file()


def test_resistance_falls_with_the_load_as_that_of_spots(run_script, tmp_path):
    names = run_script("contact_resistance")
    assert names["power"] == pytest.approx(-1, abs=0.05)
    assert (names["resistance"] < names["cluster"]).all()
    assert (tmp_path / "contact_resistance.png").is_file()


def test_thick_coatings_protect_the_substrate_and_thin_hard_ones_do_not(run_script, tmp_path):
    names = run_script("coating_thickness")
    plain = names["plain"].von_mises / names["p0"]
    assert plain == pytest.approx(0.620, rel=5e-3)
    for ratio, rows in names["table"].items():
        substrate, _, shear = rows.T
        assert substrate[0] == pytest.approx(plain, rel=0.05) and substrate[-1] < 0.4 * plain
        assert (substrate[:4].max() > plain) == (ratio > 1)
        assert 0 < shear.argmax() < len(shear) - 1
    assert (tmp_path / "coating_thickness.png").is_file()


def test_indented_plate_unloads_with_the_stiffness_of_a_circle(run_script, tmp_path):
    names = run_script("indentation")
    loaded, table = names["loaded"], names["table"]
    assert loaded.unloading_stiffness == pytest.approx(names["oliver_pharr"], rel=0.01)
    assert names["unloaded"].load == 0 < names["unloaded"].indentation < loaded.indentation
    assert table["max_pressure"].max() == 2000
    assert (tmp_path / "indentation.png").is_file()


def test_wheel_is_stressed_most_below_the_surface(run_script, tmp_path):
    names = run_script("wheel_on_rail")
    assert names["hottest"].depth > 1 and names["solution"].notes == ()
    assert (tmp_path / "wheel_on_rail.png").is_file()


def test_roughness_makes_the_contact_smaller(run_script, tmp_path):
    names = run_script("measured_surface")
    assert names["rough"].contact_area < 0.8 * names["smooth"].contact_area
    assert (tmp_path / "measured_surface.png").is_file()


def test_area_is_between_the_theories_at_light_loads(run_script, tmp_path):
    table = run_script("rough_surfaces")["table"]
    share = table["contact_fraction_corrected"]
    light = share < 0.05
    assert (table["persson_fraction"][light] < share[light]).all()
    assert (share[light] < table["bush_gibson_thomas_fraction"][light]).all()
    assert (tmp_path / "rough_surfaces.png").is_file()


def test_flow_is_that_of_a_channel_and_falls_with_the_pressure(run_script, tmp_path):
    names = run_script("leakage")
    assert names["flow"](np.full((6, 9), 0.5))[1] == pytest.approx(0.5**3, rel=1e-9)
    assert (np.diff(names["fluxes"]) < 0).all()
    assert (tmp_path / "leakage.png").is_file()


def test_wear_has_archards_volume(run_script, tmp_path):
    names = run_script("wear")
    path = (names["step"] + 1) * names["path"]
    volume = names["worn"].sum() * names["grid"].cell_area
    assert volume == pytest.approx(names["k"] * names["load"] * path, rel=1e-5)
    assert (tmp_path / "wear.png").is_file()
