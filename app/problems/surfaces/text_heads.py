"""Heads and channels of text files: Gwyddion, ESRI grids."""

import re
from itertools import takewhile

from app.base.units import UNITS, find_unit
from app.problems.surfaces.text_table import is_comment, is_row

# Gwyddion writes its heads in the user's language.
_LABELS = {
    "channel": "Channel|Kanál|Kanal|Canal|Canale|チャネル|채널|Канал",
    "width": "Width|Šířka|Breite|Anchura|Largeur|Larghezza|幅|폭|Largura|Ширина",
    "height": "Height|Výška|Höhe|Altura|Hauteur|Altezza|高さ|높이|Высота",
    "unit": "Value units|Jednotky hodnot|(?:Wert)?[Ee]inheiten|Unités|unità valore|値の単位|값 단위|"
    "Unidades de valor|Единицы измерения",
}
_GWYDDION = re.compile(
    rf"\s*[#%]\s*(?:{'|'.join(f'(?P<{key}>{labels})' for key, labels in _LABELS.items())})\s*[:：]\s*(?P<text>.*?)\s*"
)
_LENGTH = re.compile(r"([\d.,eE+-]+)\s*(\S+)")
_ESRI = re.compile(
    r"\s*(ncols|nrows|[xy]ll(?:corner|cent(?:er|re))|cellsize|dx|dy|nodata_value)\s+(\S+)\s*", re.IGNORECASE
)


def _gwyddion_entry(line):
    """Return key and text of a line of Gwyddion's head, or None."""
    match = _GWYDDION.fullmatch(line)
    return match and (next(key for key in _LABELS if match[key]), match["text"])


def select_channel(lines, wanted, advice):
    """Return one channel's lines; all others are empty.

    A line of a Gwyddion head after data begins the next channel; if no more data follow, it is a footer. `wanted` is
    the name of a channel, or its number from 0; an empty text means the only channel. Raises ValueError, with a list of
    the channels, if there is no channel `wanted`. If there are several channels and `wanted` is empty, the message also
    has the `advice` on how to choose one.

    Examples
    --------
    >>> select_channel(["# Kanal: Z", "1 2", "# Kanal: Phase", "# Einheiten: deg", "3 4"], "Phase", "")
    ['', '', '# Kanal: Phase', '# Einheiten: deg', '3 4']
    """
    comments = [(j, line) for j, line in enumerate(lines) if is_comment(line)]
    heads = [(j, entry) for j, line in comments if (entry := _gwyddion_entry(line))]
    starts, end = [0], 0
    for j, _ in heads:
        if any(map(is_row, lines[end:j])):
            starts.append(j)
        end = j + 1
    if len(starts) > 1 and not any(map(is_row, lines[starts[-1] :])):
        del starts[-1]
    ends = [*starts[1:], len(lines)]
    names = [
        dict(entry for j, entry in heads if start <= j < end).get("channel", "")
        for start, end in zip(starts, ends, strict=True)
    ]
    listing = ", ".join(f"{k} {name or '(no name)'}" for k, name in enumerate(names))
    if not wanted and len(names) > 1:
        raise ValueError(f"it has several channels, one below the other: {listing}{advice}")
    if wanted.isdecimal() and int(wanted) < len(names):
        matches = [int(wanted)]
    else:
        matches = [k for k, name in enumerate(names) if wanted in ("", name)]
    if len(matches) != 1:
        reason = "several have this name, choose by number" if matches else "not there"
        raise ValueError(f"channel {wanted}: {reason}; must be one of {listing}")
    start, end = starts[matches[0]], ends[matches[0]]
    return [line if start <= j < end else "" for j, line in enumerate(lines)]


def read_gwyddion_head(comments):
    """Return unit and sides [mm] from a Gwyddion head.

    A value that the head does not state is None.

    Examples
    --------
    >>> read_gwyddion_head(["# Width: 2,5 µm", "# Height: 1 cm", "# Value units: V"])
    ('V', (0.0025, 10.0))
    """
    head = dict(filter(None, map(_gwyddion_entry, comments)))
    try:
        sides = []
        for key in ("width", "height"):
            number, unit = _LENGTH.fullmatch(head[key]).groups()
            sides.append(float(number.replace(",", ".")) * UNITS[find_unit(unit)])
    except (LookupError, ValueError, AttributeError):
        sides = [0.0]
    return head.get("unit") or None, tuple(sides) if min(sides) > 0 else None


def find_esri_entries(lines):
    """Return the entries of an ESRI head, by names in lower case.

    Values are texts with decimal points.
    """
    return {match[1].lower(): match[2].replace(",", ".") for match in map(_ESRI.fullmatch, lines) if match}


def read_esri_head(lines, skip=0):
    """Return the entries of an ESRI head, and its number of lines.

    If `skip` is not 0, the head is the first `skip` lines. There are no entries if the text is not an ESRI grid.
    """

    def in_head(line):
        return not line.strip() or is_comment(line) or _ESRI.fullmatch(line)

    head = lines[:skip] if skip else list(takewhile(in_head, lines))
    entries = find_esri_entries(head)
    return (entries, len(head)) if {"ncols", "nrows"} <= entries.keys() else ({}, skip)
