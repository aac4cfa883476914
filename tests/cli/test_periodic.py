"""Periodic patches and self-affine surfaces from the command line: one command, one result file."""

import re

import numpy as np
import pytest
from documents import ROOT, code_blocks, run_blocks

from app.cli import plot
from app.io.result import read_result

STEEL = ("-contact_modulus", "1e5")
BOWL = """
from app import ContactProblem
def bowl(x, y):
    return (x - 1) ** 2 + (y - 1) ** 2
"""


def arguments(kind, folder):
    """Options of a small problem of some kind on the patch from 0 to 2 mm, lightly loaded."""
    if kind == "file":
        gap = 1e-3 * np.random.default_rng(2).normal(size=(16, 16))
        gap[4:7, 12:] = np.nan
        np.save(folder / "gap.npy", gap)
    (folder / "mine.py").write_text(BOWL)
    domain = ("-domain", "0,2,0,2", *STEEL, "-problem", kind)
    grid = ("-grid", "16")
    return {
        "hertz": (*domain, *grid, "-domain", "-1,1,-1,1", "-hertz_rx", 10, "-hertz_ry", 20, "-approach", 1e-3),
        "punch": (*domain, *grid, "-domain", "-1,1,-1,1", "-punch_diameter", 1.5, "-mean_pressure", 5),
        "file": (*domain, "-gap_file", folder / "gap.npy", "-mean_pressure", 5),
        "python": (*domain, *grid, "-problem_type", f"{folder / 'mine.py'}:bowl", "-mean_gap", 0.6),
        "rough": (*domain, *grid, "-surface_cutoff", 0.5, "-surface_rms_slope", 0.01, "-mean_gap", 2e-3),
    }[kind]  # fmt: skip


@pytest.mark.parametrize("kind", ["hertz", "punch", "file", "python", "rough"])
def test_every_problem_may_be_periodic(cli_here, tmp_path, kind):
    path = tmp_path / "out.h5"
    done = cli_here("-output", path, *arguments(kind, tmp_path), "-periodic", methods=["norm"])
    assert done.returncode in (0, 3), done.stderr
    assert "boundary" not in done.stderr
    result = read_result(path)
    facts = result.attributes
    assert (facts["periodic"], facts["periodic_symbol"], facts["contact_modulus"]) == (1, "spectral", 1e5)
    assert "shear_modulus" not in facts and "poisson_ratio" not in facts
    assert np.isnan(result.gap).any() == (kind in ("punch", "file"))
    assert 0 < facts["contact_fraction"] < 1
    assert facts["contact_fraction_corrected"] < facts["contact_fraction"]
    assert facts["mean_pressure"] == pytest.approx(result.pressure.mean(), rel=1e-9)
    assert facts["mean_gap"] == pytest.approx(np.nanmean(result.gap), rel=1e-9)
    assert facts["rms_height"] == pytest.approx(np.nanstd(result.undeformed_distance), rel=1e-9)
    assert abs(result.displacement.mean()) < 1e-12
    assert f"mean gap {facts['mean_gap']:.8g} mm" in done.stdout
    if kind in ("python", "rough"):
        assert facts["mean_gap"] == pytest.approx({"python": 0.6, "rough": 2e-3}[kind], rel=1e-9)
    if kind == "rough":
        assert facts["rms_slope"] == pytest.approx(0.01, rel=1e-9) == facts["surface_rms_slope"]


def test_pictures_and_a_gap_file_of_its_own(cli_here, tmp_path, capfd):
    """What a periodic run writes is drawn, and may be read as a gap again."""
    path = tmp_path / "out.h5"
    cli_here("-output", path, *arguments("rough", tmp_path), "-periodic", methods=["norm"])
    assert plot.main([str(path), "-o", str(tmp_path / "pictures"), "--dpi", "30"]) == 0
    assert capfd.readouterr().err == ""
    again = ("-problem", "file", "-gap_file", f"{path}:/undeformed_distance", "-domain", "0,2,0,2", *STEEL)
    cli_here("-output", tmp_path / "again.h5", *again, "-approach", 0, "-periodic", methods=["norm"])
    one, other = read_result(path), read_result(tmp_path / "again.h5")
    np.testing.assert_allclose(other.pressure, one.pressure, rtol=1e-9, atol=1e-9 * one.pressure.max())
    assert other.attributes["rms_slope"] == pytest.approx(one.attributes["rms_slope"], rel=1e-9)


def test_the_default_method_tells_what_it_does(cli, tmp_path):
    """-lcp_monitor, -ksp_view and -log_view of a run without a method file."""
    options = (*arguments("rough", tmp_path), "-periodic", "-lcp_monitor", "-ksp_view", "-log_view")
    options += ("-lcp_coarsest", 4)
    done = cli("-output", tmp_path / "out.h5", *options)
    assert done.returncode == 0
    assert re.fullmatch(r"warning: contact is at most \d cells wide in [xy]: .*\n", done.stderr)
    assert "sweeps with the centre of B, A on 4 x 4 cells added to the first" in done.stdout
    assert "inverse influence matrix of 16 x 16 cells, periodic" in done.stdout
    assert "InverseMult" in done.stdout and "TwoGridPC" in done.stdout
    result = read_result(tmp_path / "out.h5")
    assert f"{result.history['approach'][-1]:#.8g}" in done.stdout
    np.testing.assert_allclose(result.history["approach"][-1], result.attributes["approach"], rtol=1e-2)


def test_a_patch_periodic_in_one_direction(cli_here, tmp_path):
    """The line contact, its result file, pictures, report and a new solve from its gap."""
    path, picture = tmp_path / "out.h5", tmp_path / "pictures"
    cylinder = "-problem", "cylinder", "-cylinder_radius", 10, *STEEL, "-grid", "64,1", "-load", 100
    domain = "-domain", "-0.25,0.25,0,1"
    done = cli_here(*cylinder, *domain, "-periodic", "y", "-output", path)
    assert done.returncode == 0, done.stderr
    result = read_result(path)
    assert (result.periodic, result.periodic_symbol, result.grid.periodic) == ("y", "", "y")
    half_width = np.sqrt(4 * 100 * 10 / (np.pi * 1e5))
    assert result.max_pressure == pytest.approx(2 * 100 / (np.pi * half_width), rel=2e-3)
    picture.mkdir()
    assert plot.main([str(path), "-o", str(picture)]) in (0, None)
    assert (picture / "summary.png").exists()
    again = cli_here(
        "-problem",
        "file",
        "-gap_file",
        f"{path}:/undeformed_distance",
        *domain,
        *STEEL,
        "-load",
        100,
        "-periodic",
        "y",
    )
    assert again.returncode == 0 and f"maximum pressure {result.max_pressure:.6g}"[:-1] in again.stdout


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("-periodic", "z"), "-periodic z: must be true, false, x, y"),
        (("-periodic", "x"), "one cell wide"),
        (("-periodic", "y", "-periodic_symbol", "love"), "-periodic_symbol: has no effect here"),
        (("-periodic", "y", "-domain", "auto"), "only for smooth bodies on a patch that is not periodic"),
    ],
)
def test_what_one_direction_does_not_allow_is_one_line(cli_here, options, text):
    done = cli_here(
        "-problem",
        "cylinder",
        "-cylinder_radius",
        10,
        *STEEL,
        "-grid",
        "64,1",
        "-domain",
        "-1,1,0,1",
        "-load",
        1,
        *options,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: ") and text in done.stderr and done.stderr.count("\n") == 1


def test_example_of_the_page(capsys):
    page = (ROOT / "docs" / "periodic.md").read_text(encoding="utf-8")
    run_blocks(code_blocks(page))
    pressures, approach = capsys.readouterr().out.splitlines()
    smooth, wavy = map(float, pressures.split())
    assert smooth == pytest.approx(1, abs=2e-3) and wavy > 1.1
    assert float(approach) == pytest.approx(1, abs=2e-4)
