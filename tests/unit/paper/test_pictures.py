"""The paper's figures."""

import numpy as np
import pytest

from app.halfspace.influence import influence_quadrant
from app.halfspace.material import Material
from app.paper import pictures, reproduce


def drawn(name, outcomes=None):
    (item,) = reproduce.select_items([name])
    return item.evaluate(outcomes or {})


@pytest.mark.parametrize("name", ["fig2", "fig5", "fig6", "fig7", "fig10", "fig12"])
def test_panels_are_lettered_and_axes_labelled(name):
    panels = [axes for axes in drawn(name).axes if axes.get_label() != "<colorbar>"]
    titles = [axes.get_title(loc="left") for axes in panels]
    assert [title[:3] for title in titles] == [f"({letter})" for letter in "abcdef"[: len(panels)]]
    outer = [axes for axes in panels if not (name == "fig10" and axes in panels[:2])]
    assert all(axes.get_xlabel() for axes in outer)
    assert panels[0].get_ylabel() and panels[-2 if name == "fig10" else -1].get_ylabel()


def test_figure_2_shows_the_coefficients_in_their_places():
    image = drawn("fig2").axes[0].images[0]
    values = np.asarray(image.get_array())
    material = Material.combined(82000.0, 0.28)
    grid = pictures.Grid.from_domain(32, 32, pictures.HERTZ_DOMAIN)
    quadrant = material.shear_modulus * influence_quadrant(grid, material.kernel)
    assert values.shape == (33, 33)
    for j, i in ((0, 0), (3, 5), (-16, 16), (7, -2)):
        assert values[16 + j, 16 + i] == pytest.approx(quadrant[abs(j), abs(i)])


def test_figure_5_shows_all_eigenvalues():
    first, second, third = drawn("fig5").axes
    jacobi = first.lines[0].get_ydata()
    assert len(jacobi) == 32 and jacobi.min() == pytest.approx(-19.8, abs=0.05)
    points = second.lines[-1].get_xydata()
    assert np.sort(np.hypot(*points.T)) == pytest.approx(np.sort(third.lines[0].get_ydata()))


def test_figure_12_normal_plot_is_nearly_straight():
    axes = next(axes for axes in drawn("fig12").axes if axes.get_ylabel() == "probability")
    height, quantile = axes.lines[0].get_data()
    assert len(height) == 64**2
    assert np.corrcoef(height, quantile)[0, 1] > 0.99


def test_contact_panels_show_start_and_end():
    n = 4
    fields = {"x": list(range(n)), "y": list(range(n)), "admissible": np.ones((n, n), int).tolist()}
    full, empty = np.ones((n, n), int).tolist(), np.zeros((n, n), int).tolist()
    for status, told in (0, "0 cells"), (3, "0 cells, not converged"):
        found = {**fields, "first": full, "last": empty, "exit_status": status}
        figure = drawn("fig8", {("1", method): found for method in ("norm", "fmg_v11")})
        titles = [axes.get_title(loc="left") for axes in figure.axes]
        assert "16 cells, 16 unlike the last" in titles[0] and titles[2].endswith(f"multigrid\n{told}")
