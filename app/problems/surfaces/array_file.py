"""Two-dimensional arrays in files of several formats."""

import codecs
import gzip
import re
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import NamedTuple

import numpy as np

from app.base.errors import InputError, format_message
from app.base.memory import check_fits
from app.problems.surfaces.formats import ARRAY_KINDS, JPK_HDF5, detect_format, split_suffix
from app.problems.surfaces.text_heads import read_esri_head, select_channel
from app.problems.surfaces.text_table import UnknownText, is_comment, read_table

MAX_NON_ASCII = 0.01  # share of the bytes of a text of numbers
CONTROL_BYTES = bytes(code for code in range(32) if code not in b"\t\n\v\f\r\x1a")  # that no text contains
TEXT_MEMORY = 40  # bytes of memory for a byte of text: its lines, lists of entries, and numbers
PIECE = 1 << 24  # bytes unpacked at once
# SyntaxError and TokenError: numpy reads the header of an array as Python. RuntimeError: a dataset linked to itself.
_UNREADABLE = (
    ValueError, OSError, EOFError, KeyError, RuntimeError, MemoryError, SyntaxError, TokenError, zlib.error
)  # fmt: skip
_CONVERT = "python -m app.convert FILE -o surface.h5 reads what instruments write"


class UnknownFormat(InputError):
    """Error for a file in none of the formats read here."""

    is_text = True


class StoredArray:
    """2-D array whose rows may be read later."""

    label = "array"  # for messages

    def __init__(self, file, array):
        self.file, self._array = file, array
        if array.ndim != 2 or not all(array.shape) or array.dtype.kind not in "fiu":
            raise InputError(
                f"{self.label} {file}: holds {array.dtype} of shape {array.shape}; "
                "must be real numbers of shape (ny, nx)"
            )

    def __getstate__(self):
        """Return the state, with HDF5 read into an array."""
        return {**self.__dict__, "_array": np.asarray(self._array)}

    @property
    def shape(self):
        """Shape (ny, nx) of the array."""
        return tuple(self._array.shape)

    def rows(self, rows=slice(None)):
        """Return a copy of some rows as float64."""
        check_fits(8 * self.shape[1] * len(range(*rows.indices(self.shape[0]))), f"{self.label} {self.file}")
        return np.array(self._array[rows], dtype=np.float64, order="C")


class FileContent(NamedTuple):
    """Content of a file: array, HDF5 attributes, and head.

    `comments` are the head and the comment lines of a text, `esri` the entries in the head of an ESRI grid.
    """

    array: object
    attributes: dict
    comments: list
    esri: dict
    is_text: bool


def read_array(name, label, skip=0, channel=""):
    """Read a 2-D array from ``.npy``, ``.npz``, HDF5, or text.

    ``:/dataset`` after the name chooses one of several 2-D datasets. Rows of ``.npy`` and HDF5 are read only when
    needed. Texts may be compressed (``.gz``). `label` is "surface file" or "gap file"; only surface files may have
    heads and marks of missing points. The first `skip` lines of a text are left out. `channel` is the name or number of
    a channel of a text.

    Raises UnknownFormat for a text with words at its head and for a file that is no text, and InputError for any other
    file that cannot be read.
    """
    heights = label == "surface file"
    path, _, dataset = str(name).partition(":/")
    path = Path(path)
    if not path.is_file():
        reason = "not a file" if path.exists() else "no such file"
        stem, separator, _ = str(name).rpartition(":")
        if separator and Path(stem).is_file():
            reason = "no such file; a dataset is named as FILE:/DATASET"
        raise InputError(f"{label} {path}: {reason}")
    known = detect_format(path, skip)
    if known.kind in ("instrument", "other"):
        advice = f"; {_CONVERT}" if heights and known.kind == "instrument" else ""
        raise InputError(f"{label} {name}: is {known.description}{advice}")
    is_text = known.kind not in ARRAY_KINDS
    for option, value in (f"{skip} lines to skip", skip), (f"channel {channel}", channel):
        if value and not is_text:
            raise InputError(f"{label} {path}: {option}: allowed of text, which it is not")
    try:
        if is_text:
            return _read_text(path, skip, channel, heights)
        if known.kind == "npy":
            array, attributes = _map_npy(path), {}
        elif known.kind == "npz":
            array, attributes = _load_npz(path, dataset, heights), {}
        else:
            array, attributes = _open_hdf5(path, dataset, heights)
        return FileContent(array, attributes, [], {}, False)
    except _UNREADABLE as error:
        unknown = isinstance(error, UnknownText)
        binary = unknown and not error.is_text
        advice = f"{_CONVERT}; else: " if heights and (binary or known.kind == "unknown") else ""
        refusal = (UnknownFormat if unknown else InputError)(
            f"{label} {name}: cannot be read: {advice}{format_message(error)}"
        )
        refusal.is_text = is_text and not binary
        raise refusal from None


def _map_npy(path):
    with path.open("rb") as file:
        start = file.read(6)
    if start.startswith(b"PK"):
        raise ValueError("it is an archive of arrays, not one array: its name should end in .npz")
    if not start.startswith(np.lib.format.MAGIC_PREFIX):
        raise ValueError("it is no .npy file")  # numpy would take it for a pickle
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        if "length is greater" not in str(error):
            raise
        raise ValueError("it ends before its array does") from None


def _load_npz(path, dataset, heights):
    try:
        with zipfile.ZipFile(path) as archive:
            check_fits(sum(item.file_size for item in archive.infolist()), "what it holds")
        with np.load(path, allow_pickle=False) as arrays:
            if dataset and dataset not in arrays.files:
                raise ValueError(f"no array {dataset}")
            loaded = {dataset: arrays[dataset]} if dataset else dict(arrays)
    except (zipfile.BadZipFile, zlib.error):
        raise ValueError("it is no .npz file, or broken") from None
    return loaded[dataset or _only_name([name for name in loaded if loaded[name].ndim == 2], heights)]


def _open_hdf5(path, name, heights):
    """Return an unread HDF5 dataset and its attributes."""
    import h5py

    file, names = h5py.File(path, "r"), []
    if "Measurement_000" in file:
        raise ValueError(f"it is {JPK_HDF5}")
    if not name:
        file.visititems(lambda key, item: names.append(key) if getattr(item, "ndim", 0) == 2 else None)
        name = _only_name(names, heights)
    dataset = file.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"no dataset /{name}")
    try:
        _ = dataset.dtype
        return dataset, {key: value for key, value in dataset.attrs.items() if np.size(value)}
    except TypeError as error:  # numpy has no such type
        raise ValueError(format_message(error)) from None


def _only_name(names, heights):
    """Return the name of the only 2-D dataset, or "heights" if present."""
    if heights and "heights" in names:
        return "heights"
    if len(names) != 1:
        raise ValueError(
            f"name one of its 2-D datasets as FILE:/DATASET; there are {', '.join(names) or 'none'}"
        )
    return names[0]


def _read_text(path, skip, channel, heights):
    advice = "text, where .npy or .h5 take little"
    check_fits(path.stat().st_size * TEXT_MEMORY, advice)
    content = bytearray()
    with gzip.open(path) if split_suffix(path)[1] else path.open("rb") as file:
        while piece := file.read(PIECE):
            content += piece
            check_fits(len(content) * TEXT_MEMORY, advice)
    ways = "; choose one by app.convert --channel, or channel= of read_surface"
    choosing = ways if heights else ": leave one"
    lines = select_channel(_decode(bytes(content)).splitlines(), channel, choosing)
    esri, skip = read_esri_head(lines, skip) if heights else ({}, skip)
    comments = [line for j, line in enumerate(lines) if j < skip or is_comment(line)]
    return FileContent(read_table(lines, skip, heights), {}, comments, esri, True)


def _decode(content):
    coding = _detect_utf16(content)
    try:
        return content.decode(coding or "utf-8-sig")
    except UnicodeDecodeError:
        non_ascii = len(content) - len(content.translate(None, bytes(range(128, 256))))
        control = len(content) - len(content.translate(None, CONTROL_BYTES))
        if coding or control or non_ascii > MAX_NON_ASCII * len(content) + 8:
            formats = ".npy, .npz, .h5, .hdf5, and text"
            raise UnknownText(f"it is no text; formats: {formats}", is_text=False) from None
        return content.decode("cp1252", "replace")


def _detect_utf16(content):
    """Return the name of the coding of a text in UTF-16, which may begin without a mark; else None."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    starts = ((coding, content[:64].decode(coding, "ignore")) for coding in ("utf-16-le", "utf-16-be"))
    return next((coding for coding, start in starts if re.fullmatch(r"[\t\r\n -~]+", start)), None)
