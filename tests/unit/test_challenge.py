"""What the page of the Contact Mechanics Challenge is made of: surface, measures, and going on after a stop."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from app.plots import style
from app.reference import Westergaard
from benchmarks.challenge import __main__ as challenge
from benchmarks.challenge import measures, surface


def waves(n, *numbers):
    """Cosines with these numbers of waves in x and y on n x n points."""
    x, y = 2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(n)[:, None] / n
    return sum(np.cos(a * x + b * y) for a, b in numbers)


@pytest.mark.parametrize("n", [12, 13, 16, 24, 31, 48])
def test_resampling_keeps_the_waves_that_the_grid_has(n):
    np.testing.assert_allclose(
        surface.resample(waves(16, (3, -2), (0, 5)), n), waves(n, (3, -2), (0, 5)), atol=1e-13
    )
    if n < 16:
        np.testing.assert_allclose(
            surface.resample(waves(16, (1, 1), (2, -7)), n), waves(n, (1, 1)), atol=1e-13
        )


def test_rms_slope_of_waves():
    expected = 2 * np.pi / surface.SIDE * np.sqrt((13 + 25) / 2)
    assert surface.rms_slope(waves(24, (3, -2), (0, 5))) == pytest.approx(expected, rel=1e-13)


def test_surface_file(tmp_path):
    good, bad = tmp_path / "good.h5", tmp_path / "bad.h5"
    with h5py.File(good, "w") as file:
        file["surface"] = waves(8, (1, 2))
    with h5py.File(bad, "w") as file:
        file["surface"] = np.ones((3, 4))
        file["other"] = 1
    np.testing.assert_allclose(surface.read_surface(good), 0.1 * waves(8, (1, 2)))
    for path, told in ((bad, "n x n"), (tmp_path / "none.h5", "no such file")):
        with pytest.raises(ValueError, match=told):
            surface.read_surface(path)


def test_patches_hang_together_over_the_period():
    contact = np.zeros((6, 8), bool)
    contact[0, 0] = contact[-1, 0] = contact[0, -1] = True  # one over both rims
    contact[2, 2:5] = contact[3, 5] = True  # corners part
    assert measures.patch_cells(contact).tolist() == [3, 3, 1]
    everywhere = np.roll(contact, (2, -3), (0, 1))
    assert measures.patch_cells(everywhere).tolist() == [3, 3, 1]
    assert measures.patch_cells(np.ones((3, 4), bool)).tolist() == [12]
    assert measures.patch_cells(np.zeros((3, 4), bool)).size == 0


def test_perimeter_correction():
    """Yastrebov et al. (2017): (pi - 1 + ln 2) / 24 of a cell for every side between contact and none."""
    contact = np.zeros((5, 6), bool)
    contact[[0, -1], 0] = contact[2, 3] = True  # two cells over the rim, one alone: 6 + 4 sides
    expected = (3 - 10 * (np.pi - 1 + np.log(2)) / 24) / 30
    assert measures.corrected_fraction(contact) == pytest.approx(expected, rel=1e-14)
    assert measures.corrected_fraction(np.ones((3, 4), bool)) == 1


def test_stiffness_of_an_exponential_is_exact():
    gaps = np.array([2.0, 1.5, 0.7, 0.0, 0.0])
    rows = [{"load": 0.1 * np.exp(-2 * gap), "mean_gap": gap} for gap in gaps]
    load, value = measures.stiffness(rows)
    np.testing.assert_allclose(value, 2 * load)
    assert len(load) == 3


def westergaards(distance, pressures, asked):
    """In the place of the solver: Westergaard's solution of a wave in x."""
    n = len(distance)
    for pressure in pressures:
        asked.append((n, pressure))
        c = Westergaard(np.ptp(distance) / 2, surface.SIDE, challenge.MODULUS, pressure)
        x, y = surface.SIDE * np.arange(n) / n, np.zeros((n, 1))
        fields = SimpleNamespace(pressure=c.pressure(x, y), gap=c.gap(x, y))
        yield SimpleNamespace(**vars(fields), converged=True, operator_applications=1.0, solve_seconds=0.1)


def test_a_run_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(style, "write_figure", lambda figure, target, kind, dpi: target.touch())
    output, asked = tmp_path / "page.md", []
    heights = 1e-3 * waves(16, (1, 0))

    def solve(distance, pressures):
        return westergaards(distance, pressures, asked)

    def stopped(distance, pressures):
        for k, solution in enumerate(westergaards(distance, pressures, asked)):
            if k == 2:
                raise KeyboardInterrupt
            yield solution

    loads = 0.01, 0.1, 0.5, 1.0
    with pytest.raises(KeyboardInterrupt):
        challenge.run(heights, "wave", [16], output, loads, stopped)
    del asked[:]
    challenge.run(heights, "wave", [16, 32], output, loads, solve)
    assert [n for n, _ in asked] == [16, 16, 32, 32, 32, 32]
    rows = challenge.read_rows(output.with_suffix(".csv"))
    assert len(rows) == 8
    full = next(row for row in rows if row["load"] == 1 and row["size"] == 32)
    assert (full["contact_fraction"], full["mean_gap"], full["patches"]) == (1, 0, 1)
    first = next(row for row in rows if row["load"] == 0.01 and row["size"] == 32)
    exact = Westergaard(1e-3, surface.SIDE, 25.0, 0.01 * 25 * surface.rms_slope(heights))
    assert first["contact_fraction"] == pytest.approx(exact.contact_fraction, abs=1 / 16)
    densities = challenge.read_rows(output.with_name("page-distributions.csv"))
    assert {(row["kind"], row["load"]) for row in densities} == {
        (kind, load) for kind in ("pressure", "gap", "patch") for load in (0.01, 0.1, 1.0)
    }
    text = output.read_text()
    assert "32²" in text and "shorter waves are left out" in text
    assert all((tmp_path / f"page-{part}.png").exists() for part in ("loads", "distributions"))
    del asked[:]
    challenge.run(heights, "wave", [32], output, loads, solve)
    assert asked == [] and output.read_text() == text


def test_densities_are_those_of_all_cells_and_of_open_ones():
    rng = np.random.default_rng(2)
    pressure = np.maximum(rng.normal(size=(40, 40)), 0)
    gap = np.where(pressure > 0, 0, rng.random((40, 40)))
    found = measures.densities(pressure, gap, 1.0, 1.0)
    of = measures.numbers(pressure, gap, 1.0, 1.0)
    assert found["pressure"] @ np.diff(measures.PRESSURES) == pytest.approx(of["contact_fraction"])
    assert found["gap"] @ np.diff(measures.GAPS) == pytest.approx(1)
    assert found["patch"].sum() * np.log10(measures.AREAS[1] / measures.AREAS[0]) == of["patches"]
