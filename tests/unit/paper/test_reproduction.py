"""The paper's data: how its numbers are counted, what the report says of them, and pictures."""

import numpy as np
import pytest

from app.halfspace.influence import influence_quadrant
from app.halfspace.material import Material
from app.paper import pictures, report, reproduce, studies, tables
from app.paper.report import Entry


def test_counts_of_the_paper():
    outcome = {
        "exit_status": 0, "active_set_iterations": 6, "work_units": 26.25, "inner_iterations": 71,
    }  # fmt: skip
    data = tables.evaluate_methods({("32", "V11"): outcome, ("32", "norm_cg"): outcome})
    assert data == {"32": {"V11": [6, 26.2], "norm_cg": [6, 71]}}
    assert tables.inexact_counts(outcome, 4) == [6, 36]
    assert tables.inexact_counts({**outcome, "exit_status": 3}, 4) is None


def test_what_does_not_converge_is_no_number_of_the_paper():
    """Status 3 has a result, of which no table and no study prints a digit."""
    trace = {"errors": [9.004, 45.286], "exit_status": 0}
    stopped = {**trace, "exit_status": 3}
    (table4,) = reproduce.select_items(["table4"])
    for outcome, discrete, errors in (trace, 45.29, [9.0, 45.29]), (stopped, None, None):
        data = table4.evaluate({("8", "errors"): outcome, ("8", "discrete"): outcome})
        assert data == {"8": {"errors": errors, "discrete": discrete}}
    assert {report.format_entry(entry.ours) for entry in report.pair_entries("table4", data)} == {"diverged"}
    solve = {"active_set_iterations": 77, "work_units": 77.0, "exit_status": 3}
    (inexact,) = reproduce.select_items(["inexact"])
    section = report.study_section(inexact, inexact.evaluate({("4", "1"): solve}))
    assert "77" not in section.text() and "not solved" in section.text()


@pytest.mark.parametrize(
    ("paper", "ours", "difference", "noticeable"),
    [
        ([9, 35], [9, 35.4], "+0 (+1%)", False),
        ([7, 24], [8, 27], "+1 (+12%)", True),
        ([20, 200], [18, 190], "-2 (-5%)", True),
        ([9, 0.19], [9, 0.204], "+0 (+0.01)", False),
        ([9, 0.19], [9, 0.25], "+0 (+0.06)", True),
        (45.29, 45.06, "-1%", False),
        (3.70, 4.18, "+13%", True),
        (None, [21, 126], "one diverged", True),
        (None, None, "", False),
    ],
)
def test_differences(paper, ours, difference, noticeable):
    entry = Entry("32 × 32", "V(1,1)", paper, ours)
    assert (entry.difference(), entry.noticeable) == (difference, noticeable)


def test_verdict_names_what_differs():
    same, other = Entry("a", "b", [9, 35], [9, 35.4]), Entry("c", "d", [9, 35], [5, 35])
    assert (
        report.summarize([same])
        == "1 entries, 1 of them equal in all digits printed; no noticeable difference."
    )
    assert report.summarize([same, other]).endswith("noticeably different: c d.")


def test_numbers_are_written_as_in_the_paper():
    assert [report.format_entry(v) for v in ([9, 0.194], [9, 35.4375], [5, 110], 45.286, None)] == [
        "9 (0.19)", "9 (35)", "5 (110)", "45.29", "diverged",
    ]  # fmt: skip


def test_spread():
    assert studies.quantiles([3, None, 1, 2, 10]) == [1, 2.5, 10]
    assert studies.quantiles([None]) is None


# -- pictures ------------------------------------------------------------------------------------------------


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
    quadrant = material.shear_modulus * influence_quadrant(grid, material.compliance)
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
