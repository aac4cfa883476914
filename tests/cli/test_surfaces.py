"""Measured surfaces on several ranks."""

import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, Material, Sphere, read_surface, solve
from app.io.result import read_result

HEIGHTS = np.random.default_rng(4).normal(size=(20, 16)).round(3)


@pytest.mark.ranks(2, 3)
def test_measured_surface_gives_the_same_result_on_any_number_of_ranks(cli, tmp_path, ranks):
    heights = HEIGHTS + np.arange(16)
    heights[5:8, 3], heights[0, 0] = np.nan, np.nan
    np.save(tmp_path / "s.npy", heights)
    done = cli(
        "-problem", "sphere", "-sphere_radius", 2, "-surface_file", tmp_path / "s.npy", "-surface_unit", "nm",
        "-surface_level", "quadratic", "-surface_missing", "fill", "-domain", "-0.08,0.08,-0.1,0.1",
        "-surface_s_filter", 0.025, "-surface_l_filter", 0.15,
        "-young", "210e3,3e3", "-poisson", "0.3,0.35", "-load", 0.05, "-lcp_rtol", 1e-10,
        "-output", tmp_path / "out.h5", ranks=ranks,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "contact modulus E* 3368.89 N/mm2, of E 210000 and 3000, nu 0.3 and 0.35" in done.stdout
    result = read_result(tmp_path / "out.h5")
    facts = result.attributes
    assert facts["surface_level"] == "quadratic" and list(facts["young"]) == [210e3, 3e3]
    surface = read_surface(tmp_path / "s.npy", "nm", "quadratic", missing="fill")
    grid, pair = surface.grid((-0.08, 0.08, -0.1, 0.1)), Material.pair((210e3, 3e3), (0.3, 0.35))
    surface = surface.filtered(grid, 0.025, 0.15)
    alone = solve(
        ContactProblem(grid, pair, Sphere(2.0), surfaces=[surface]), load=0.05, comm=MPI.COMM_SELF,
        options={"lcp_rtol": 1e-10},
    )  # fmt: skip
    np.testing.assert_allclose(result.pressure, alone.pressure, rtol=1e-7, atol=2e-8 * alone.max_pressure)
    assert facts["approach"] == pytest.approx(alone.approach, rel=1e-9)


@pytest.mark.ranks(2)
def test_refused_in_one_line_on_all_ranks(cli, tmp_path, ranks):
    np.save(tmp_path / "s.npy", HEIGHTS)
    surface = ("-problem", "rough", "-contact_modulus", 1, "-load", 1, "-surface_file", tmp_path / "s.npy")
    done = cli(*surface, ranks=ranks)
    assert done.returncode == 2
    assert done.stderr.count("error: -surface_unit is missing: ") == 1
