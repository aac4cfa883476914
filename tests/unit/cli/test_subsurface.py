"""Stresses of a solution, and wrong questions for them."""

import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from results import MAX_PRESSURE, with_attributes, write

from app import read_result
from app.api.subsurface import stress, survey
from app.base.errors import InputError
from app.cli import report, subsurface
from app.halfspace.layer import Layer
from app.parallel.slabs import Slabs
from app.plots import figures


def test_stresses_do_not_overwrite_their_result(path, tmp_path, capsys):
    result = path.rename(tmp_path / "subsurface.h5")
    assert subsurface.main([str(result), "-o", str(tmp_path)]) == 2
    assert "is the input" in capsys.readouterr().err
    assert read_result(result).load


@pytest.mark.parametrize("name", ["subsurface.h5", "subsurface.png"])
def test_stresses_are_written_only_if_all_files_can_be(path, tmp_path, capsys, name):
    folder = tmp_path / "below"
    (folder / name).mkdir(parents=True)
    assert subsurface.main([str(path), "-o", str(folder)]) == 2
    assert f"{name}: exists and is not a regular file" in capsys.readouterr().err
    assert list(folder.iterdir()) == [folder / name]


def test_file_of_stresses_has_sections_line_and_planes(path, made, tmp_path, capsys):
    folder = tmp_path / "below"
    assert subsurface.main([str(path), "-o", str(folder), "--planes", "0.5,2", "--depths", "40"]) == 0
    said = capsys.readouterr().out
    assert re.findall("largest (.*) stress .* of the maximum pressure.*\n  at x = .* depth", said) == [
        "von Mises",
        "shear",
    ]
    assert (folder / "subsurface.png").read_bytes().startswith(b"\x89PNG")
    with h5py.File(folder / "subsurface.h5") as file:
        assert 0.55 < file.attrs["max_von_mises"] / MAX_PRESSURE < 0.68
        assert file["section_x/sigma_xx"].shape == (40, 64) and file["section_y/sigma_xy"].shape == (40, 48)
        assert file["plane_1"].attrs["depth"] == 2 and file["plane_1/von_mises"].shape == (48, 64)
        shear, mises = (file[f"plane_1/{name}"][()] for name in ("max_shear", "von_mises"))
        assert 0.28 < file.attrs["max_shear"] / MAX_PRESSURE < 0.34 and file.attrs["max_shear_depth"] > 0
        assert (mises / 2 <= shear * 1.0001).all() and (shear <= 1.0001 * mises / 3**0.5).all()
        assert file["section_x/sigma_zz"].dims[0][0].name == "/depth"
        depth = file["depth"][()]
        k = np.argmin(abs(depth - file.attrs["max_von_mises_depth"]))
        assert file["line/von_mises"][k] == pytest.approx(file.attrs["max_von_mises"], rel=2e-3)
        row = np.argmin(abs(made.y - file.attrs["y"]))
        column = np.argmin(abs(made.x - file.attrs["x"]))
        assert file["section_x/sigma_zz"][:, column] == pytest.approx(file["line/sigma_zz"][()])
        surface = file["section_x/sigma_zz"][0]
        assert surface == pytest.approx(-made.pressure[row], abs=1e-6 * MAX_PRESSURE)


@pytest.mark.parametrize("pressure", [0.0, 7.0])
def test_uniform_stress_has_no_position(made, pressure):
    """Below a uniform pressure that is repeated for ever no cell is more stressed than others."""
    even = replace(made, pressure=np.full_like(made.pressure, pressure) * (1 + 1e-14 * np.arange(64)))
    periodic = with_attributes(even, periodic_symbol="spectral")
    for result in (periodic, even):  # beside a free patch there is no pressure
        below = stress(result)
        texts = subsurface.summary(*below.maxima(), result, below)
        figure = subsurface.draw(result, survey(below, depths=9))
        for text in (*texts, figure.axes[0].get_title()):
            assert ("everywhere" in text) == ("depth" not in text) == (result is periodic or not pressure)


COATINGS = {
    "one": {"coating_young": 400e3, "coating_poisson": 0.25, "coating_thickness": 1.5},
    "both": {
        "coating_young": np.array([400e3, 100e3]),
        "coating_poisson": np.array([0.25, 0.4]),
        "coating_thickness": np.array([1.5, 2.5]),
    },
}


def coated(made, coatings, base=200e3):
    bodies = {"young": np.array([base, np.inf]), "poisson": np.array([0.3, 0.35])}
    return with_attributes(made, without=["poisson_ratio"], **bodies, **COATINGS[coatings])


def test_stresses_of_a_coated_body_have_both_sides_of_the_interface(made, tmp_path, capsys):
    write(tmp_path / "coated.h5", MPI.COMM_SELF, Slabs(48), coated(made, "one"))
    folder = tmp_path / "below"
    assert subsurface.main([str(tmp_path / "coated.h5"), "-o", str(folder), "--depths", "30"]) == 0
    printed = capsys.readouterr().out
    for text in (
        r"von Mises stress \S+ .*, in the coating", r"von Mises stress \S+ .*, in the substrate",
        r"von Mises stress at the interface .*in the coating", r"shear stress on the interface \S+ N/mm2",
    ):  # fmt: skip
        assert re.search("largest " + text, printed), text
    with h5py.File(folder / "subsurface.h5") as file:
        depth = file["depth"][()]
        assert file.attrs["interface"] == 1.5
        (k,) = np.flatnonzero(depth == 1.5)
        assert 1.5 < depth[k + 1] < 1.5 + 1e-9 and (np.diff(depth) > 0).all()
        coating, substrate = (
            np.array([file[f"section_x/sigma_{name}"][m] for name in ("xx", "zz", "xz")]) for m in (k, k + 1)
        )
        np.testing.assert_allclose(coating[1:], substrate[1:], atol=1e-6 * MAX_PRESSURE)
        assert abs(coating - substrate)[0].max() > 0.1 * MAX_PRESSURE
        largest = [file.attrs[f"max_von_mises_{part}"] for part in ("coating", "substrate")]
        assert file.attrs["max_von_mises"] == max(largest)
        assert file.attrs["max_interface_shear_depth"] == 1.5


@pytest.mark.parametrize("periodic", ["", "y"])
def test_pictures_of_a_coated_body_have_a_line_at_the_interface(made, periodic):
    result = with_attributes(coated(made, "one"), periodic=periodic)
    figure = subsurface.draw(result, survey(stress(result), depths=9))
    assert "layer of 1.5 mm, ν = 0.25, on ν = 0.3" in figure._suptitle.get_text()
    panels = [axes for axes in figure.axes if axes.get_ylabel().startswith("depth")]
    below = figures.summary_figure(result).axes[3]
    for axes in (*panels, below):
        lines = [line for line in axes.lines if np.ptp(line.get_ydata()) == 0 and line.get_ydata()[0] == 1.5]
        assert len(panels) == 3 and lines
    shallow = subsurface.draw(result, survey(stress(result), depths=9, deepest=1.0))
    lines = [line for axes in shallow.axes for line in axes.lines if len(line.get_ydata()) == 2]
    assert all(np.ptp(line.get_ydata()) for line in lines)


def test_report_of_a_layer_on_a_rigid_base_ends_at_the_base(made, monkeypatch):
    monkeypatch.setattr(report, "_encode", lambda figure: (b"no picture", 300))
    result = coated(made, "one", np.inf)
    text = " ".join(report.web_page(result).split())
    assert "Largest von Mises stress" in text and "shear stress on the interface" in text
    assert "in the coating" in text and "in the substrate" not in text
    assert survey(stress(result), depths=9, deepest=4.0).depths[-1] == 1.5


def test_layer_is_that_of_the_chosen_body(made):
    one, both = (coated(made, name) for name in COATINGS)
    assert stress(one).layer == stress(one, body=1).layer == stress(both).layer
    assert stress(one).layer == Layer(1.5, (400e3, 200e3), (0.25, 0.3))
    assert stress(both, body=2).layer == Layer(2.5, (100e3, np.inf), (0.4, 0.35))
    elastic = with_attributes(one, young=np.array([200e3, 3e3]))
    assert stress(elastic, body=2).nu == 0.35
    for result, options, message in (
        (one, {"body": 2}, "body 2: is rigid"),
        (one, {"body": 3}, "body 3: allowed: 1, 2"),
        (one, {"poisson_ratio": 0.3}, "no effect with a coating"),
        (with_attributes(one, without=["coating_young"]), {}, "attribute coating_young: is missing"),
        (with_attributes(one, coating_thickness=-1.0), {}, "thickness -1: must be positive"),
    ):
        with pytest.raises(InputError, match=message):
            stress(result, **options)
