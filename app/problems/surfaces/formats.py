"""Formats of files that hold heights or gaps: read here, by another program, or to be changed into another one."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple


class Format(NamedTuple):
    """One row of `FORMATS`.

    Attributes
    ----------
    kind : str
        ``npy``, ``npz``, ``hdf5`` or ``text``: read here. ``instrument``: read by `app.convert` with
        SurfaceTopography. ``other``: not read.
    suffixes : tuple of str
        Ends of file names, in lower case.
    beginning : bytes
        Start of the file's content; decides where the name is that of a text or unknown.
    what : str
        Description for messages, with advice.
    """

    kind: str
    suffixes: tuple = ()
    beginning: bytes = b""
    what: str = ""


FORMATS = (
    Format("instrument", beginning=b"Wyko ASCII Data File Format", what="Wyko's ASCII format"),
    Format("instrument", beginning=b"aISO-", what="an SDF file"),
    Format("instrument", beginning=b"# File Format = ASCII", what="SPIP's ASCII format"),
    Format("npy", (".npy",)),
    Format("npz", (".npz",)),
    Format("hdf5", (".h5", ".hdf5")),
    Format("text", (".txt", ".csv", ".dat", ".xyz", ".asc")),
    Format("instrument", (".zip",), what="an archive: unpack it, unless it is of contact.engineering"),
    Format("other", (".7z", ".bz2", ".rar", ".tar", ".tgz", ".xz", ".zst"), what="an archive: unpack it"),
    Format(
        "other",
        (".bmp", ".gif", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"),
        what="an image, which holds colours without a unit: export the heights from the program that made it, "
        "as text or in the instrument's own format",
    ),
    Format(
        "other",
        (".3mf", ".igs", ".iges", ".obj", ".off", ".ply", ".step", ".stl", ".stp"),
        what="a mesh: export its heights on a regular grid of x and y, as text with lines x, y, z",
    ),
    Format(
        "other",
        (".ods", ".xls", ".xlsm", ".xlsx"),
        what="a spreadsheet: save the sheet that has the heights as .csv",
    ),
)
UNKNOWN = Format("unknown")
TEXTS = next(known.suffixes for known in FORMATS if known.kind == "text")
ARRAYS = tuple(
    suffix for known in FORMATS if known.kind in ("npy", "npz", "hdf5") for suffix in known.suffixes
)
_LONGEST = max(len(known.beginning) for known in FORMATS)


def suffix_of(path):
    """Return the lower-case suffix, and whether ``.gz`` follows it. Not collective.

    Examples
    --------
    >>> suffix_of("scan.CSV.gz"), suffix_of("scan.x3p"), suffix_of("scan.gz")
    (('.csv', True), ('.x3p', False), ('', True))
    """
    path = Path(path)
    packed = path.suffix.lower() == ".gz"
    return (Path(path.stem) if packed else path).suffix.lower(), packed


def format_of(path, skip=0):
    """Return the `Format` of a file, by its name and by its beginning.

    Not collective. The beginning does not count where lines of it are skipped.
    """
    suffix, packed = suffix_of(path)
    found = next((known for known in FORMATS if suffix in known.suffixes), UNKNOWN)
    if packed and found.kind in ("npy", "npz", "hdf5", "instrument"):
        return Format("other", what="compressed: unpack it (gunzip)")
    if packed or skip or found.kind not in ("text", "unknown"):
        return found
    with Path(path).open("rb") as file:
        start = file.read(_LONGEST)
    return next((known for known in FORMATS if known.beginning and start.startswith(known.beginning)), found)
