"""Notes on wrong units and spikes."""

import numpy as np
import pytest

from app import ContactProblem, Material, read_surface, solve
from app.problems.surfaces.doubts import note_doubtful_units, note_spike

from .maps import HEIGHTS, X, Y


def test_spikes_are_noted_and_surfaces_are_not(saved):
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(200, 300))
    smooth = np.cumsum(np.cumsum(noise, axis=0), axis=1)
    edge = np.where(np.indices(noise.shape)[1] > 150, 50.0, 0.0) + 0.01 * noise
    for heights in (noise, smooth, edge, np.zeros((200, 300)), noise[:1], noise[:1, :1]):
        assert note_spike(read_surface(heights, "um")) == []
    noise[120, 30] += 100
    noise[120, 31] = np.nan
    surface = read_surface(noise, "um", spacing=(0.001, 0.001))
    assert "row 120, column 30 is 101 um above its highest neighbour" in note_spike(surface)[0]
    filtered = surface.filtered(surface.grid(), s_filter=0.005)
    assert note_spike(filtered) == note_spike(surface)  # smeared, not removed
    assert note_spike(read_surface(-noise, "um")) == []  # pits carry nothing
    solution = solve(
        ContactProblem(surface.grid(), Material.from_contact_modulus(1e3), surfaces=[surface]), load=0.01
    )
    assert sum("has spikes" in note for note in solution.notes) == 1


@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("heights", "level"),
    [
        (0.1 * X - 0.7 * Y, "none"),
        (1 / 3 + 0 * HEIGHTS, "mean"),
        (1e3 * X + Y / 7, "plane"),
        (300 + X**2 - X * Y / 3, "quadratic"),
        (np.pi * Y + 0 * X, "none"),
        (0.011 * X + 0.26 * Y + 350, "mean"),
    ],
)
def test_rounding_is_neither_spikes_nor_flatness(heights, level, precision):
    surface = read_surface(heights.astype(precision), "um", level, spacing=(1e-3, 1e-3))
    assert note_spike(surface) == []
    assert not note_doubtful_units(surface, surface.grid())
    assert note_spike(surface.resampled()) == []


# What is measured: size of a cell [um], rms slope.
SURFACES = {
    "wafer, AFM": (0.01, 8e-3),
    "polished glass, interferometer": (1.0, 5e-4),
    "lapped gauge block": (1.0, 5e-3),
    "race of a bearing": (1.0, 0.03),
    "ground": (2.0, 0.08),
    "honed": (2.0, 0.1),
    "turned": (5.0, 0.12),
    "cast": (10.0, 0.3),
    "blasted": (2.0, 0.45),
}

MISTAKES = {
    "none": (1, 1),
    "spacing um for mm": (1e3, 1),
    "heights um for mm": (1, 1e3),
    "heights mm for um": (1, 1e-3),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistaken_unit_is_noted_and_a_right_one_is_not(saved, mistake):
    """The table of docs/surfaces.md."""
    notes, (wider, higher) = 0, MISTAKES[mistake]
    heights = np.random.default_rng(8).normal(size=(48, 64))
    step = np.sqrt(sum(np.mean(np.diff(heights, axis=axis) ** 2) for axis in (0, 1)))
    for cell, slope in SURFACES.values():
        surface = read_surface(saved(higher * slope * cell / step * heights), "um")
        side = 1e-3 * cell * wider
        grid = surface.grid((0, 64 * side, 0, 48 * side))
        problem = ContactProblem(grid, Material.combined(1.0, 0.3), surfaces=[surface])
        notes += len(note_doubtful_units(surface, grid))
        assert "64 x 48 heights in um, cells of " in problem.describe()["surface_read"]
    assert (
        notes == {"none": 0, "spacing um for mm": 9, "heights um for mm": 8, "heights mm for um": 7}[mistake]
    )
