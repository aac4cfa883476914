"""Self-affine rough problem: the same surface on every grid that carries it."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.special import erf

from app import ContactProblem, ContactSolver, Sphere, solve
from app.base.errors import InputError
from app.cli.problem_options import PROBLEM_OPTIONS, make_problem
from app.halfspace.periodic_symbol import wave_numbers
from app.options.option_table import OptionReader

OPTIONS = {
    "problem": "rough", "domain": "-1,2,0,2", "contact_modulus": "100", "surface_cutoff": "0.25",
    "surface_rolloff": "1", "surface_rms_slope": "0.1", "surface_seed": "5", "periodic": "",
}  # fmt: skip


def made(grid, without=(), **texts):
    given = {name: text for name, text in (OPTIONS | {"grid": grid} | texts).items() if name not in without}
    return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)[0]


def heights(problem):
    return -problem.shape_on(problem.grid)


def spectrum(problem):
    """Fourier coefficients of the height counted from the corner of the patch, up to 13 and 8 waves."""
    grid = problem.grid
    z = np.fft.rfft2(heights(problem)) / grid.n
    kx, ky = np.arange(14), np.arange(-8, 9)
    centre = np.exp(-1j * np.pi * (kx / grid.nx + ky[:, None] / grid.ny))
    return z[ky, :14] * centre


@pytest.mark.parametrize("grid", ["32,20", "54,64", "27,33"])
def test_the_same_waves_on_every_grid(grid):
    # 12 waves of 0.25 mm fit into x, 8 into y.
    np.testing.assert_allclose(spectrum(made(grid)), spectrum(made("96")), rtol=0, atol=1e-14)


def test_theories_stand_beside_the_contact_fraction_of_flat_rough_bodies():
    """At light loads both are the same line but for the factor pi / 2 of their slopes; other bodies have none."""
    problem = made("32")
    with ContactSolver(problem) as solver:
        path = solver.path(mean_pressure=[0.01, 0.02, 20.0])
        light, twice, heavy = path
    slope = light.problem["persson_fraction"] / (0.01 / (100 * light.rms_slope))
    assert slope == pytest.approx(np.sqrt(8 / np.pi), rel=1e-5)
    ratio = light.problem["bush_gibson_thomas_fraction"] / light.problem["persson_fraction"]
    assert ratio == pytest.approx(np.pi / 2, rel=1e-5)
    assert heavy.problem["persson_fraction"] == pytest.approx(erf(np.sqrt(2) * 20 / (100 * heavy.rms_slope)))
    assert np.isnan(heavy.problem["bush_gibson_thomas_fraction"])
    column = path.table["persson_fraction"]
    assert column[1] == twice.problem["persson_fraction"] and column[1] == pytest.approx(
        2 * column[0], rel=1e-4
    )
    ball = ContactProblem(problem.grid, problem.material, Sphere(10.0), surfaces=problem.surfaces)
    assert "persson_fraction" not in solve(ball, mean_pressure=0.01).problem


@pytest.mark.parametrize("grid", ["32,20", "96"])
def test_rms_values_are_those_of_the_spectrum(grid):
    problem = made(grid)
    z = np.fft.rfft2(heights(problem)) / problem.grid.n
    g = problem.grid
    i, j = np.arange(g.nx // 2 + 1), np.fft.fftfreq(g.ny, 1 / g.ny)
    qx, qy = wave_numbers(g, i, j)
    twice = np.where((i > 0) & (2 * i < g.nx), 2.0, 1.0)
    assert np.sum(twice * np.abs(z) ** 2 * (qx**2 + qy[:, None] ** 2)) == pytest.approx(0.01, rel=1e-12)
    facts = problem.describe()
    assert facts["surface_rms_slope"] == pytest.approx(0.1, rel=1e-14)
    assert facts["surface_rms_height"] == pytest.approx(heights(problem).std(), rel=1e-12)
    assert abs(heights(problem).mean()) < 1e-15  # the mean plane


def test_by_height_and_other_material():
    problem = made("32", without=["surface_rms_slope", "contact_modulus"], surface_rms_height="0.01",
                   shear_modulus="72", poisson_ratio="0.28")  # fmt: skip
    assert heights(problem).std() == pytest.approx(0.01, rel=1e-12)
    assert problem.material.contact_modulus == pytest.approx(100)


def test_without_roll_off_it_is_the_longest_side():
    assert made("32", without=["surface_rolloff"]).describe()["surface_rolloff"] == 3.0


def test_slabs_make_the_same():
    problem = made("32,24")
    whole = problem.shape_on(problem.grid)
    for rows in (slice(0, 9), slice(9, 10), slice(10, 24), slice(4, 4)):
        np.testing.assert_allclose(problem.shape_on(problem.grid, rows), whole[rows], rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("grid", "without", "texts", "message"),
    [
        ("24,15", (), {}, r"cut-off 0.25: .* needed: at least 24,16 cells"),
        ("16", (), {"domain": "0,1,0,1", "surface_cutoff": "0.1"}, "at least 20,20 cells"),
        ("32", (), {"surface_cutoff": "1e-9"}, "at least 6000000000,4000000000 cells"),
        ("32", ["surface_cutoff"], {}, "-surface_cutoff is missing"),
        ("32", ["surface_rms_slope"], {}, "neither -surface_rms_slope nor -surface_rms_height"),
        ("32", (), {"surface_rms_height": "1"}, "either its rms height or its rms slope"),
        ("32", (), {"surface_hurst": "1.2"}, "-surface_hurst 1.2: must be"),
        ("32", (), {"surface_rolloff": "0.2"}, "positive and in this order"),
        ("32", ["contact_modulus"], {}, "neither -contact_modulus .* exactly one of these ways"),
        ("32", ["contact_modulus"], {"shear_modulus": "1"}, "-poisson_ratio is missing"),
        ("32", ["periodic"], {"periodic_symbol": "love"}, "-periodic_symbol: has no effect here"),
    ],
)
def test_refused(grid, without, texts, message):
    with pytest.raises((InputError, ValueError), match=message):
        made(grid, without, **texts)
