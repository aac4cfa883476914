"""Heads of texts: channels, languages and units of Gwyddion's export, and options that override them."""

import numpy as np
import pytest

from app import InputError, read_surface
from app.cli.convert import main as convert
from app.problems.gap_file import GapFile

HEIGHTS = np.random.default_rng(8).normal(size=(2, 6, 9)).round(6)
GERMAN = "Kanal", "Breite", "Höhe", "Einheiten"
ENGLISH = "Channel", "Width", "Height", "Value units"


def head(name="Z", sides=("9 µm", "12 µm"), unit="m", labels=ENGLISH):
    return [f"# {label}: {text}" for label, text in zip(labels, (name, *sides, unit), strict=True)]


def rows(heights):
    return ["\t".join(map(str, row)) for row in heights]


@pytest.fixture
def written(tmp_path):
    def write(*lines, name="s.txt"):
        (tmp_path / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
        return tmp_path / name

    return write


@pytest.mark.parametrize("between", [[], [""], ["# made by hand"]])
@pytest.mark.parametrize("second", [slice(4), slice(1), slice(1, 2)])
def test_one_of_two_channels_is_read_by_name_or_number(written, tmp_path, between, second):
    """Each with its own head; which one is never guessed."""
    other = head("Phase", ("18 µm", "6 µm"), "nm")[second]
    path = written(*head("Topo"), *rows(HEIGHTS[0]), *between, *other, *rows(HEIGHTS[1][:4]))
    for refuse in (lambda: read_surface(path, "nm"), lambda: GapFile(path)):
        with pytest.raises(InputError, match="several channels, one below the other: 0 Topo, 1 "):
            refuse()
    assert convert([str(path), "-o", str(tmp_path / "s.h5")]) == 2
    for channel in ("Topo", "0", 0):
        surface = read_surface(path, channel=channel)
        np.testing.assert_allclose(surface.heights(), 1e3 * HEIGHTS[0], rtol=1e-15)
        assert surface.spacing == pytest.approx((1e-3, 2e-3))
    if second == slice(4):
        for channel in "Phase", "1":
            assert convert([str(path), "-o", str(tmp_path / "s.h5"), "--channel", channel]) == 0
            surface = read_surface(tmp_path / "s.h5")
            np.testing.assert_allclose(surface.heights(), 1e-6 * HEIGHTS[1][:4], rtol=1e-12)
            assert surface.spacing == pytest.approx((2e-3, 1.5e-3))
    with pytest.raises(InputError, match="channel X: not there; must be one of 0 Topo, 1 "):
        read_surface(path, channel="X")


def test_words_before_a_head_are_no_channel(written):
    path = written("Export of 1 image", *head(unit="nm"), *rows(HEIGHTS[0]))
    with pytest.raises(InputError, match="skip the 5 lines at the head"):
        read_surface(path)
    surface = read_surface(path, skip=1)
    np.testing.assert_allclose(surface.heights(), 1e-6 * HEIGHTS[0], rtol=1e-15)


def test_a_footer_is_no_channel(written):
    path = written(*rows(HEIGHTS[0]), *head(unit="nm"))
    surface = read_surface(path)
    np.testing.assert_allclose(surface.heights(), 1e-6 * HEIGHTS[0], rtol=1e-15)


@pytest.mark.parametrize("labels", [GERMAN, ("Canal", "Largeur", "Hauteur", "Unités"), ENGLISH])
def test_heads_in_other_languages_are_read(written, labels):
    path = written(*head("Höhe", ("9,0 µm", "0,0012 cm"), "m", labels), *rows(HEIGHTS[0]))
    surface = read_surface(path)
    np.testing.assert_allclose(surface.heights(), 1e3 * HEIGHTS[0], rtol=1e-15)
    assert surface.spacing == pytest.approx((1e-3, 2e-3))


@pytest.mark.parametrize("unit", ["V", "deg", "A", "m/s"])
def test_values_that_are_no_lengths_are_no_heights(written, tmp_path, unit):
    path = written(*head(unit=unit), *rows(HEIGHTS[0]))
    for length in None, "um":
        with pytest.raises(InputError, match=f"says {unit}, which is no length.*override=True"):
            read_surface(path, length)
    words = [str(path), "-o", str(tmp_path / "s.h5"), "--unit", "um"]
    assert convert(words) == convert([*words, "--crop", "0,9,0,6"]) == 2
    assert convert([*words, "--override"]) == 0
    expected = read_surface(path, "um", override=True)
    np.testing.assert_allclose(expected.heights(), 1e-3 * HEIGHTS[0], rtol=1e-15)
    np.testing.assert_array_equal(read_surface(tmp_path / "s.h5").heights(), expected.heights())


def test_override_replaces_a_wrong_width(written, tmp_path, capsys):
    """A map of 160 m; the rest stays as the file states it."""
    path = written(*head(sides=("160 m", "12 µm")), *rows(HEIGHTS[0]))
    spacing = (1e-3, 3e-3)
    with pytest.raises(InputError, match=r"says .* itself; if that is wrong, add override=True"):
        read_surface(path, spacing=spacing)
    words = [str(path), "-o", str(tmp_path / "s.h5"), "--spacing", "0.001,0.003"]
    assert convert(words) == 2 and "if that is wrong, add --override" in capsys.readouterr().err
    assert convert([*words, "--override"]) == 0
    for surface in read_surface(path, spacing=spacing, override=True), read_surface(tmp_path / "s.h5"):
        assert surface.spacing == pytest.approx(spacing)
        np.testing.assert_allclose(surface.heights(), 1e3 * HEIGHTS[0], rtol=1e-12)
    other = read_surface(path, "nm", override=True)
    np.testing.assert_allclose(other.heights(), 1e-6 * HEIGHTS[0], rtol=1e-15)
    assert other.spacing == pytest.approx((160e3 / 9, 2e-3))
    for nothing in ({}, {"level": "plane"}):
        with pytest.raises(InputError, match="override=True .*: has no effect"):
            read_surface(path, override=True, **nothing)


def test_override_replaces_the_unit_of_heights_alone(tmp_path):
    """Cells whose unit is that of the heights keep it under height_unit, and change with unit."""
    points = np.stack([*np.meshgrid(2.0 * np.arange(5), 3.0 * np.arange(4)), HEIGHTS[0][:4, :5]], -1).reshape(
        -1, 3
    )
    np.savetxt(tmp_path / "s.xyz", points, fmt="%.6f")
    assert convert([str(tmp_path / "s.xyz"), "-o", str(tmp_path / "s.h5"), "--unit", "um"]) == 0
    surface = read_surface(tmp_path / "s.h5", height_unit="nm", override=True)
    np.testing.assert_allclose(surface.heights(), 1e-6 * HEIGHTS[0][:4, :5], rtol=1e-9)
    assert surface.spacing == pytest.approx((2e-3, 3e-3))
