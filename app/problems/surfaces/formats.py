"""File formats of heights and gaps."""

from pathlib import Path
from typing import NamedTuple


class Format(NamedTuple):
    """File format, recognised by suffixes or first bytes.

    A file of `kind` "instrument" is read by `app.convert` with SurfaceTopography. A file of kind "other" cannot be
    read. The `description` says in a message what the file is.
    """

    kind: str
    suffixes: tuple = ()
    beginning: bytes = b""
    description: str = ""


JPK_HDF5 = "a JPK file of HDF5, which holds raw counts and thumbnails: export the heights as .jpk or text"
FORMATS = (
    Format("npy", (".npy",)),
    Format("npz", (".npz",)),
    Format("hdf5", (".h5", ".hdf5")),
    Format("text", (".txt", ".csv", ".dat", ".xyz", ".asc")),
    Format("instrument", (), b"Wyko ASCII Data File Format", "Wyko's ASCII format"),
    Format("instrument", (), b"aISO-", "an SDF file"),
    Format("instrument", (), b"# File Format = ASCII", "SPIP's ASCII format"),
    Format("other", (), b"DSCOMPRESSED", "compressed by Digital Surf: save it without compression, or export text"),
    Format("other", (".h5-jpk",), b"", JPK_HDF5),
    Format("instrument", (".zip",), b"", "an archive: unpack it, unless it is of contact.engineering"),
    Format("other", (".7z", ".bz2", ".rar", ".tar", ".tgz", ".xz", ".zst"), b"", "an archive: unpack it"),
    Format(
        "other", (".bmp", ".gif", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"), b"",
        "an image, which holds colours without a unit: export the heights from the program that made it, "
        "as text or in the instrument's own format",
    ),
    Format(
        "other", (".3mf", ".igs", ".iges", ".obj", ".off", ".ply", ".step", ".stl", ".stp"), b"",
        "a mesh: export its heights on a regular grid of x and y, as text with lines x, y, z",
    ),
    Format(
        "other", (".ods", ".xls", ".xlsm", ".xlsx"), b"",
        "a spreadsheet: save the sheet that has the heights as .csv",
    ),
)  # fmt: skip
UNKNOWN = Format("unknown")
ARRAY_KINDS = "npy", "npz", "hdf5"
TEXTS = tuple(suffix for known in FORMATS if known.kind == "text" for suffix in known.suffixes)
ARRAYS = tuple(suffix for known in FORMATS if known.kind in ARRAY_KINDS for suffix in known.suffixes)


def split_suffix(path):
    """Return a path's lower-case suffix, and whether ``.gz`` follows.

    Examples
    --------
    >>> split_suffix("scan.CSV.gz"), split_suffix("scan.x3p"), split_suffix("scan.gz")
    (('.csv', True), ('.x3p', False), ('', True))
    """
    path = Path(path)
    packed = path.suffix.lower() == ".gz"
    return (path.with_suffix("") if packed else path).suffix.lower(), packed


def detect_format(path, skip=0):
    """Return the `Format` of a file by its name and first bytes.

    If the file is compressed, or has lines to `skip`, its name alone decides.
    """
    suffix, packed = split_suffix(path)
    by_name = next((known for known in FORMATS if suffix in known.suffixes), UNKNOWN)
    if packed and by_name.kind in (*ARRAY_KINDS, "instrument"):
        return Format("other", description="compressed: unpack it (gunzip)")
    if packed or skip or by_name.kind not in ("text", "unknown"):
        return by_name
    with Path(path).open("rb") as file:
        content = file.read(64)
    marked = (known for known in FORMATS if known.beginning)
    return next((known for known in marked if content.startswith(known.beginning)), by_name)
