"""The option -flow."""

import csv

import h5py
import numpy as np
import pytest
from documents import ROOT, code_blocks, run_blocks

from app.cli import plot, report, xdmf
from app.io.result import read_result

FACE = (
    *(
        "-problem",
        "rough",
        "-grid",
        32,
        "-domain",
        "0,1,0,1",
        "-periodic",
        "-young",
        "10,inf",
        "-poisson",
        "0.5,0.3",
    ),
    *("-surface_hurst", 0.8, "-surface_rolloff", 0.5, "-surface_cutoff", 0.12, "-surface_rms_slope", 0.1),
    *("-surface_seed", 4),
)


@pytest.mark.ranks(1, 2)
def test_flow_is_printed_saved_and_drawn(cli, tmp_path, ranks):
    file = tmp_path / "a.h5"
    done = cli(*FACE, "-mean_pressure", 0.05, "-flow", "-flow_ksp_type", "fcg", "-output", file, ranks=ranks)
    assert done.returncode == 0, done.stderr
    result = read_result(file)
    assert f"flow in x: transmissivity {result.transmissivity_x:.6g} mm3" in done.stdout
    assert "-flow_ksp_type fcg" in result.options and 0 < result.flow_error < 1e-4
    if ranks == 1:
        for main, *words in ((plot.main, "-o", str(tmp_path)), (xdmf.main,), (report.main, "--no-stress")):
            assert main([str(file), *words]) == 0
        assert (tmp_path / "flow.png").is_file()
        assert 'Name="fluid_pressure"' in (tmp_path / "a.xdmf").read_text()
        assert "hydraulic aperture in x" in (tmp_path / "a.html").read_text()


def test_a_path_says_where_the_gap_closes(cli_here, tmp_path):
    file = tmp_path / "a.h5"
    done = cli_here(*FACE, "-mean_pressure_path", "0.05,0.1,2", "-flow", "-output", file)
    assert done.returncode == 0, done.stderr
    assert "the gap closes in x between mean pressure 0.1 and 2 N/mm2" in done.stdout
    assert "flow in x: sealed; in y: sealed" in done.stdout
    rows = list(csv.DictReader((tmp_path / "a.csv").open()))
    assert [row["percolates_x"] for row in rows] == ["True", "True", "False"]
    with h5py.File(file) as h5:
        assert h5["path/transmissivity_x"][:] == pytest.approx(
            [float(row["transmissivity_x"]) for row in rows]
        )


def test_options_of_the_flow_are_refused_before_the_solve(cli_here):
    loaded = *FACE, "-mean_pressure", 0.05
    for words, text in (
        (("-flow_ksp_rtol", 1e-3), "-flow_ksp_rtol: needs -flow"),
        (("-flow", "-flow_ksp_bogus", 1), "-flow_ksp_bogus: PETSc does not use this option"),
        (("-flow", "-flow_pc_type", "nonsense"), "nonsense"),
        (("-flow", "-flow_ksp_rtol", "abc"), "solver options: Input string abc has no numeric value"),
    ):
        done = cli_here(*loaded, *words)
        assert done.returncode == 2 and done.stderr.startswith("error: ") and text in done.stderr
        assert not done.stdout


def test_flow_of_the_page():
    names = run_blocks(code_blocks((ROOT / "docs/flow.md").read_text(encoding="utf-8")))
    flow, table = names["flow"], names["path"].table
    assert flow.percolates_x and flow.flow_error < 1e-4
    assert (np.diff(table["transmissivity_x"]) < 0).all()
