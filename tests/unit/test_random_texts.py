"""Random texts of many formats: each is read as it was meant, or refused."""

import numpy as np
import pytest

from app import read_surface
from app.base.errors import InputError
from app.problems.gap_file import GapFile

LABELS = [("Channel", "Width", "Height", "Value units"), ("Kanal", "Breite", "Höhe", "Einheiten")]
UNITS = {"m": 1e3, "nm": 1e-6, "Å": 1e-7, "pm": 1e-9, "in": 25.4, "cm": 10.0}
MARKS = ["nan", "***", "BAD", "#N/A", "-1.#IND", "n/a"]


class Texts:
    """Random tables of numbers as programs write them."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.comma, self.quoted = self.rng.random(2) < 0.3
        separators = [" ", "\t", ";", "; "] if self.comma and not self.quoted else [" ", "\t", ";", ", ", ","]
        self.separator, self.exponent = self.rng.choice(separators), self.rng.choice(["e", "E", "D"])
        self.mark = self.rng.choice(MARKS)

    def number(self, value):
        text = self.mark if np.isnan(value) else f"{value:.6e}".replace("e", self.exponent)
        text = text.replace(".", ",") if self.comma else text
        return f'"{text}"' if self.quoted else text

    def lines(self, table):
        return [self.separator.join(map(self.number, row)) for row in table]

    def heights(self):
        heights = self.rng.normal(size=self.rng.integers(8, 16, 2))
        heights = heights.cumsum(0).cumsum(1) if self.rng.random() < 0.3 else heights
        heights[self.rng.random(heights.shape) < 0.05] = np.nan
        return np.vectorize(lambda value: float(f"{value:.6e}"))(heights)

    def channel(self, name="Z"):
        """Lines of a channel with its head, heights, unit and cells."""
        heights, unit = self.heights(), self.rng.choice([*UNITS, "V"])
        sides = self.rng.integers(1, 900, 2) / 10
        texts = name, *(f"{side:.1f} µm" for side in sides), unit
        texts = [text.replace(".", ",") for text in texts] if self.comma else texts
        labels = LABELS[self.rng.integers(len(LABELS))]
        head = [f"# {label}: {text}" for label, text in zip(labels, texts, strict=True)]
        return head + self.lines(heights), heights, unit, 1e-3 * sides / heights.shape[::-1]


@pytest.fixture
def write(tmp_path):
    def write(lines):
        (tmp_path / "s.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return tmp_path / "s.txt"

    return write


def is_read(path, heights, spacing=None, **how):
    surface = read_surface(path, **how)
    np.testing.assert_allclose(surface.heights(), heights, rtol=1e-12)
    assert spacing is None or surface.spacing == pytest.approx(spacing, rel=1e-4)


def is_refused(path, *, gap=False, **how):
    with pytest.raises(InputError):
        read_surface(path, **how)
    if gap:
        with pytest.raises(InputError):
            GapFile(path)


@pytest.mark.parametrize("seed", range(20))
def test_matrices_with_heads_and_coordinates(write, seed):
    texts = Texts(seed)
    heights = texts.heights()
    lines, words = texts.lines(heights), ["Instrument A7", "Sample;12"]
    for head in [], ["# by hand", ""]:
        is_read(write(head + lines), heights, unit="mm")
    is_read(write(words + lines), heights, unit="mm", skip=2)
    is_refused(write(words + lines), unit="mm")
    x = 0.7 + np.arange(heights.shape[1]) * texts.rng.uniform(0.1, 3)
    is_refused(write(texts.lines(np.vstack([x, heights]))), unit="mm")
    is_refused(write([*lines, texts.rng.choice(["", "# next"]), *lines]), unit="mm", gap=True)


@pytest.mark.parametrize("seed", range(20))
def test_channels(write, seed):
    texts = Texts(seed)
    names = "Z", texts.rng.choice(["Z", "Z2"])
    channels = [texts.channel(name) for name in names]
    path = write([line for lines, *_ in channels for line in lines])
    is_refused(path, gap=True)
    for k, (_, heights, unit, spacing) in enumerate(channels):
        for name in {k, names[k]} if names[0] != names[1] else {k}:
            if unit in UNITS:
                is_read(path, UNITS[unit] * heights, spacing, channel=name)
            else:
                is_refused(path, channel=name)
    if names[0] == names[1]:
        is_refused(path, channel="Z")


@pytest.mark.parametrize("seed", range(20))
def test_points_and_line_scans(write, seed):
    texts = Texts(seed)
    heights = np.nan_to_num(texts.heights(), nan=0.5)
    ny, nx = heights.shape
    dx, dy = texts.rng.uniform(0.1, 3, 2)
    x, y = np.meshgrid(5 + dx * np.arange(nx), dy * np.arange(ny))
    points = np.stack([x, y, heights], -1).reshape(-1, 3)
    for order in range(nx * ny), texts.rng.permutation(nx * ny), np.lexsort(points[:, :2].T):
        is_read(write(texts.lines(points[order])), heights, (dx, dy), unit="mm")
    x = dx * np.arange(ny) if seed % 2 else texts.rng.uniform(0, 9, ny).cumsum()
    is_refused(write(texts.lines(np.stack([x, heights[:, 0]], -1))), unit="mm", gap=True)
