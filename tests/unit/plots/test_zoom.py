"""Maps enlarge a contact that is small in its patch."""

from dataclasses import replace

import numpy as np
import pytest
from results import made_up_result

from app.plots import figures, pictures
from app.plots.zoom import find_view


@pytest.fixture
def small_contact():
    result = made_up_result(60, 40)
    contact = np.zeros((40, 60), bool)
    contact[10:18, 30:42] = 1
    pressure = np.where(contact, 5.0 + np.arange(60), 0.0)
    distance = np.ones((40, 60))
    return replace(result, contact=contact, pressure=pressure, undeformed_distance=distance)


def test_view_is_the_contact_with_a_margin(small_contact):
    rows, columns = find_view(small_contact)
    assert (rows.start, rows.stop) == (10 - 3, 18 + 3) and (columns.start, columns.stop) == (30 - 4, 42 + 4)


def test_view_ends_with_the_patch(small_contact):
    moved = np.roll(small_contact.contact, (-9, 17), axis=(0, 1))  # rows 1 to 8, columns 47 to 58
    rows, columns = find_view(replace(small_contact, contact=moved))
    assert (rows.start, rows.stop) == (0, 9 + 3) and (columns.start, columns.stop) == (47 - 4, 60)


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_whole_patch_is_shown_without_contact_or_with_a_large_one(small_contact, share):
    contact = np.zeros((40, 60), bool)
    contact[: int(40 * share)] = 1
    assert find_view(replace(small_contact, contact=contact)) == (slice(0, 40), slice(0, 60))


@pytest.mark.parametrize("draw", [figures.pressure_figure, figures.contact_figure])
def test_map_shows_the_view_and_the_patch_in_an_inset(small_contact, draw):
    axes = draw(small_contact).axes[0]
    x, y = small_contact.x, small_contact.y
    ends = x[26] - (x[1] - x[0]) / 2, x[46] - (x[1] - x[0]) / 2
    assert axes.get_xlim() == pytest.approx(ends) and axes.get_ylim()[0] > y[6]
    inset = axes.child_axes[-1]
    (marked,) = inset.patches
    assert inset.get_xlim() == pytest.approx((x[0] - (x[1] - x[0]) / 2, x[-1] + (x[1] - x[0]) / 2))
    assert (marked.get_x(), marked.get_x() + marked.get_width()) == pytest.approx(ends)


def test_colours_and_counts_are_those_of_the_whole_patch(small_contact):
    axes = figures.contact_figure(small_contact).axes[0]
    fraction = small_contact.attributes["contact_fraction"]
    assert f"{100 * fraction:.3g}%" in axes.get_legend().get_texts()[0].get_text()
    image = figures.pressure_figure(small_contact).axes[0].images[-1]
    assert image.get_array().shape == (14, 20) and image.get_clim()[1] == pytest.approx(46)


def test_map_of_spots_shows_the_view(small_contact):
    axes = pictures.spots_figure(small_contact.patches()).axes[0]
    assert np.ptp(axes.get_xlim()) < 0.5 * np.ptp(small_contact.x) and len(axes.child_axes) == 1


def test_inset_hides_no_contact(small_contact):
    inset = figures.contact_figure(small_contact).axes[0].child_axes[-1]
    assert inset.get_facecolor()[3] == 0
