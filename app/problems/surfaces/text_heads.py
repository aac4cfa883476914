"""Heads of texts: Gwyddion's ASCII export, in the languages it is written in, and ESRI grids; channels of a text."""

from __future__ import annotations

import re
from itertools import takewhile
from typing import NamedTuple

from app.base.units import UNITS, find_unit
from app.problems.surfaces.text_table import is_comment, is_row

# Gwyddion translates what it writes.
_LABELS = {
    "channel": "Channel|Kanál|Kanal|Canal|Canale|チャネル|채널|Канал",
    "width": "Width|Šířka|Breite|Anchura|Largeur|Larghezza|幅|폭|Largura|Ширина",
    "height": "Height|Výška|Höhe|Altura|Hauteur|Altezza|高さ|높이|Высота",
    "unit": "Value units|Jednotky hodnot|(?:Wert)?[Ee]inheiten|Unités|unità valore|値の単位|값 단위|"
    "Unidades de valor|Единицы измерения",
}
_HEAD = re.compile(
    rf"\s*[#%]\s*(?:{'|'.join(f'(?P<{key}>{labels})' for key, labels in _LABELS.items())})\s*[:：]\s*(?P<text>.*?)\s*"
)
_LENGTH = re.compile(r"([\d.,eE+-]+)\s*(\S+)")
# All that the head of an ESRI grid has, of which the first two say what it is.
_ESRI = re.compile(
    r"\s*(ncols|nrows|[xy]ll(?:corner|cent(?:er|re))|cellsize|dx|dy|nodata_value)\s+(\S+)\s*", re.IGNORECASE
)


class TextChannel(NamedTuple):
    """A channel of a text: its name, empty if its head has none, and its lines."""

    name: str
    lines: slice


def _head_entry(line):
    """Return key and text of a line of Gwyddion's head, or None."""
    found = _HEAD.fullmatch(line)
    return found and (next(key for key in _LABELS if found[key]), found["text"])


def channels_of(lines):
    """Split a text where a line of Gwyddion's head follows data.

    Not collective.

    Returns
    -------
    list of TextChannel
        At least one; all lines belong to one of them.

    Examples
    --------
    >>> [channel.name for channel in channels_of(["# Kanal: Z", "1 2", "# Kanal: Phase", "# Einheiten: deg", "3 4"])]
    ['Z', 'Phase']
    """
    heads = [(j, entry) for j, line in enumerate(lines) if is_comment(line) and (entry := _head_entry(line))]
    starts, end = [0], 0
    for j, _ in heads:
        if any(map(is_row, lines[end:j])):
            starts.append(j)
        end = j + 1
    # A head without data behind it is a footer.
    if len(starts) > 1 and not any(map(is_row, lines[starts[-1] :])):
        del starts[-1]
    found = []
    for start, stop in zip(starts, [*starts[1:], len(lines)], strict=True):
        said = dict(entry for j, entry in heads if start <= j < stop)
        found.append(TextChannel(said.get("channel", ""), slice(start, stop)))
    return found


def gwyddion_head(comments):
    """Return the unit, None if there is none, and the sides [mm], None if unknown, of Gwyddion's head.

    Not collective.

    Examples
    --------
    >>> gwyddion_head(["# Width: 2,5 µm", "# Height: 1 cm", "# Value units: V"])
    ('V', (0.0025, 10.0))
    """
    said = dict(filter(None, map(_head_entry, comments)))
    try:
        sides = []
        for key in ("width", "height"):
            number, unit = _LENGTH.fullmatch(said[key]).groups()
            sides.append(float(number.replace(",", ".")) * UNITS[find_unit(unit)])
    except (LookupError, ValueError, AttributeError):
        sides = [0.0]
    return said.get("unit") or None, tuple(sides) if min(sides) > 0 else None


def cells_of(comments):
    """Return dx, dy as texts where lines `cellsize`, or `dx` and `dy`, state them, or None. Not collective."""
    said = {found[1].lower(): found[2].replace(",", ".") for found in map(_ESRI.fullmatch, comments) if found}
    both = said.get("cellsize")
    sides = said.get("dx", both), said.get("dy", both)
    return None if sides == (None, None) else sides


def _may_be_esri(line):
    """True for the lines that may stand in the head of an ESRI grid, empty ones and comments included."""
    return not line.strip() or is_comment(line) or _ESRI.fullmatch(line)


def esri_head(lines, skip=0):
    """Return the entries at the head of an ESRI grid, by lower-case names, and its lines; none if it is no such grid.

    Not collective. The head consists of the first `skip` lines, if any are to be skipped.
    """
    head = lines[:skip] if skip else list(takewhile(_may_be_esri, lines))
    said = {found[1].lower(): found[2] for found in map(_ESRI.fullmatch, head) if found}
    return (said, len(head)) if {"ncols", "nrows"} <= said.keys() else ({}, skip)
