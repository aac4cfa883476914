"""Pictures of results."""

from dataclasses import replace

import numpy as np
import pytest
from results import MAX_PRESSURE, SEMI_AXES, made_up_result, with_attributes

from app.cli.plot import save_pictures
from app.io.result import HISTORY
from app.plots.pictures import PICTURES, analytic_reference, pictures_of


def test_reference_is_the_hertz_contact_of_the_paper(result):
    exact = analytic_reference(result)
    assert exact.pressure(0.0, 0.0) == pytest.approx(MAX_PRESSURE, rel=1e-6)
    a, b = SEMI_AXES
    assert exact.pressure(0.6 * a, 0.0) == pytest.approx(0.8 * MAX_PRESSURE, rel=1e-6)
    assert exact.pressure(0.0, 0.6 * b) == pytest.approx(0.8 * MAX_PRESSURE, rel=1e-6)
    assert analytic_reference(with_attributes(result, problem="sphere")).pressure(0.0, 0.0) == exact.pressure(
        0.0, 0.0
    )
    assert analytic_reference(with_attributes(result, problem="punch")) is None
    for missing in ("problem", "hertz_rx", "contact_modulus", "analytic_approach"):
        assert analytic_reference(with_attributes(result, without=[missing])) is None


def test_the_undeformed_distance_is_drawn_in_its_unit(result):
    [(name, figure)] = pictures_of(result, ["undeformed_distance"])
    [image] = figure.axes[0].images
    shown = image.get_array()
    assert name == "undeformed_distance" and "undeformed distance" in figure.axes[0].get_title()
    in_cells = result.undeformed_distance[~np.isnan(result.undeformed_distance)]
    assert np.ptp(shown) == pytest.approx(
        np.ptp(in_cells) * (1000 if "µm" in figure.axes[0].get_title() else 1)
    )


def test_unusual_results_are_drawn(result, tmp_path):
    none = replace(
        result,
        pressure=np.zeros_like(result.pressure),
        contact=np.zeros_like(result.contact),
        history={name: np.zeros(0, dtype) for name, dtype in HISTORY.items()},
    )
    diverged = replace(
        with_attributes(result, converged=False, load=np.nan),
        pressure=np.full_like(result.pressure, np.nan),
        displacement=np.full_like(result.pressure, np.nan),
        history={k: np.full_like(v, np.inf) if k == "residual" else v for k, v in result.history.items()},
    )
    infinite = replace(
        with_attributes(diverged, approach=np.nan), gap=np.where(result.gap > 0, np.inf, result.gap)
    )
    infinitely = replace(
        with_attributes(infinite, approach=np.inf), gap=np.where(result.y > 0, result.gap.T, np.inf).T
    )
    cases = none, diverged, infinite, infinitely, made_up_result(40, 1), made_up_result(40, 30, 3.0)
    for number, case in enumerate(cases):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert all(
            path.stat().st_size > 500 for path in save_pictures(pictures_of(case, PICTURES), folder, dpi=20)
        )
