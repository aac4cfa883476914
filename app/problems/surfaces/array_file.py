"""Two-dimensional arrays in files of several formats: measured, or made elsewhere."""

from __future__ import annotations

import codecs
import gzip
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError

import numpy as np

from app.base.errors import InputError, format_message
from app.base.memory import check_fits
from app.problems.arrays import refuse_large
from app.problems.surfaces.formats import format_of, suffix_of
from app.problems.surfaces.text_heads import channels_of
from app.problems.surfaces.text_table import UnknownText, is_comment, read_table

_STRANGE = 0.01  # share of characters beyond ASCII that texts of numbers do not reach
_NEVER = [bytes([code]) for code in range(32) if code not in b"\t\n\v\f\r\x1a"]  # in no text
# What readers raise. SyntaxError, TokenError: of the header of an array, which numpy reads as Python. RuntimeError: a
# dataset that is linked to itself.
_UNREADABLE = (
    ValueError, OSError, EOFError, KeyError, RuntimeError, MemoryError, SyntaxError, TokenError, zlib.error
)  # fmt: skip
_BYTES_PER_BYTE = 40  # of memory, for a byte of text: a line is a list of texts, then of numbers
_PIECE = 1 << 24  # bytes unpacked at once


class UnknownFormat(InputError):
    """The file is no text, or a text with a head that is not known: another reader may know its format.

    Attributes
    ----------
    is_text : bool
    """

    is_text = True


class NoText(UnknownText):
    """The file has bytes that no text has."""


class ArrayFile:
    """A two-dimensional array in a file, read a few rows at a time where the format allows it.

    ``.npy``; ``.npz``, ``.h5``, ``.hdf5`` or ``.h5:/dataset``; anything else is read as text, a row of cells a line
    (see `app.problems.surfaces.text_table`), unless `app.problems.surfaces.formats` knows better. Texts may be
    compressed (``.gz``). The first row is the one of smallest y.

    Not collective: every rank opens the file for itself.

    Parameters
    ----------
    name : str
        File name, with ``:/dataset`` behind it if an HDF5 or .npz file holds more than one 2-D dataset.
    skip : int
        Lines at the head of a text that are none of the array.
    channel : str
        Name or number, from 0, of a channel of a text that has several, one below the other.

    Attributes
    ----------
    attributes : dict
        Of the dataset of an HDF5 file, which may say units; else empty.
    is_text : bool
    comments : list of str
        Lines of a text that begin with #, and those skipped at its head.

    Raises
    ------
    UnknownFormat
        If it is read as text and is none, or has words at its head.
    InputError
        If there is no such file or dataset, or it is not a 2-D array of real numbers.
    """

    what, missing, how_to_skip = "array file", "a missing value", ""  # for messages
    how_to_choose = ": leave one"  # one of several channels
    elsewhere = ""  # what reads formats of instruments
    marks = False  # whether texts may mark missing values in other ways than by nan
    preferred = ""  # dataset that is taken where there are several

    def __init__(self, name, skip=0, channel=""):
        name, self.attributes, self.comments, self.skip = str(name), {}, [], skip
        path, _, dataset = name.partition(":/")
        self.file, self.path, self._dataset = name, Path(path), dataset
        if not self.path.is_file():
            raise InputError(f"{self.what} {path}: {self._why_not()}")
        known = format_of(self.path, skip)
        if known.kind in ("instrument", "other"):
            elsewhere = self.elsewhere if known.kind == "instrument" else ""
            raise InputError(f"{self.what} {name}: is {known.what}{elsewhere and f'; {elsewhere}'}")
        self.is_text = known.kind not in ("npy", "npz", "hdf5")
        for option, given in (f"{skip} lines to skip", skip), (f"channel {channel}", channel):
            if given and not self.is_text:
                raise InputError(f"{self.what} {path}: {option}: allowed of text, which it is not")
        try:
            if self.is_text:
                self._rows = self._read_text(channel)
            else:
                read = {"npy": self._map_npy, "npz": self._load_npz, "hdf5": self._open_hdf5}
                self._rows = read[known.kind]()
        except _UNREADABLE as error:
            binary = isinstance(error, NoText)
            other = self.elsewhere and (binary or known.kind == "unknown")
            elsewhere = f"{self.elsewhere}; else: " if other else ""
            refusal = (UnknownFormat if isinstance(error, UnknownText) else InputError)(
                f"{self.what} {name}: cannot be read: {elsewhere}{format_message(error)}"
            )
            refusal.is_text = self.is_text and not binary
            raise refusal from None
        if self._rows.ndim != 2 or not all(self._rows.shape) or self._rows.dtype.kind not in "fiu":
            raise InputError(
                f"{self.what} {name}: holds {self._rows.dtype} of shape {self._rows.shape}; "
                "needed: real numbers of shape (ny, nx)"
            )

    def _why_not(self):
        if self.path.exists():
            return "not a file"
        file, separator, _ = self.file.rpartition(":")
        if separator and Path(file).is_file():
            return "no such file; a dataset is named as FILE:/DATASET"
        return "no such file"

    def _map_npy(self):
        with self.path.open("rb") as file:
            start = file.read(6)
        if start.startswith(b"PK"):
            raise ValueError("it is an archive of arrays, not one array: its name should end in .npz")
        if not start.startswith(np.lib.format.MAGIC_PREFIX):
            raise ValueError("it is no .npy file")  # numpy takes whatever it does not know for a pickle
        try:
            return np.load(self.path, mmap_mode="r", allow_pickle=False)
        except ValueError as error:
            if "length is greater" not in str(error):  # of the map of the file than of the file
                raise
            raise ValueError("it ends before its array does") from None

    def _load_npz(self):
        try:
            with zipfile.ZipFile(self.path) as archive:
                check_fits(sum(item.file_size for item in archive.infolist()), "what it holds")
            with np.load(self.path, allow_pickle=False) as arrays:
                if self._dataset and self._dataset not in arrays.files:
                    raise ValueError(f"no array {self._dataset}")
                found = {name: arrays[name] for name in [self._dataset] if name} or dict(arrays)
        except (zipfile.BadZipFile, zlib.error):
            raise ValueError("it is no .npz file, or broken") from None
        return found[self._dataset or self._only([name for name in found if np.ndim(found[name]) == 2])]

    def _only(self, found):
        """The dataset that is meant, where none is named, of those with two dimensions."""
        if self.preferred in found:
            return self.preferred
        if len(found) != 1:
            raise ValueError(
                f"name one of its 2-D datasets as FILE:/DATASET; there are: {', '.join(found) or 'none'}"
            )
        return found[0]

    def _open_hdf5(self):
        import h5py

        file, name, found = h5py.File(self.path, "r"), self._dataset, []
        if not name:
            file.visititems(lambda key, item: found.append(key) if getattr(item, "ndim", 0) == 2 else None)
            name = self._only(found)
        if not isinstance(file.get(name), h5py.Dataset):
            raise ValueError(f"no dataset /{name}")
        try:
            self.attributes = {key: value for key, value in file[name].attrs.items() if np.size(value)}
            _ = file[name].dtype
        except TypeError as error:  # a type that numpy has not
            raise ValueError(format_message(error)) from None
        return file[name]

    def _read_text(self, channel):
        lines = _decoded(self._content()).splitlines()
        lines = self._choose_channel(lines, channel)
        self.skip = self._lines_of_head(lines, self.skip)
        self.comments = [line for j, line in enumerate(lines) if j < self.skip or is_comment(line)]
        return read_table(lines, self.missing, self.skip, self.marks, self.how_to_skip)

    def _content(self):
        """Bytes of a text, unpacked."""
        refuse = "text, where .npy or .h5 take little"
        check_fits(self.path.stat().st_size * _BYTES_PER_BYTE, refuse)
        if not suffix_of(self.path)[1]:
            return self.path.read_bytes()
        content = bytearray()
        with gzip.open(self.path) as file:
            while piece := file.read(_PIECE):
                content += piece
                check_fits(len(content) * _BYTES_PER_BYTE, refuse)
        return bytes(content)

    def _choose_channel(self, lines, wanted):
        """Return the lines with those of other channels empty."""
        channels = channels_of(lines)
        names = ", ".join(f"{j} {channel.name or '(no name)'}" for j, channel in enumerate(channels))
        if not wanted and len(channels) > 1:
            raise ValueError(f"it has several channels, one below the other: {names}{self.how_to_choose}")
        chosen = channels
        if wanted:
            chosen = channels[int(wanted) :][:1] if wanted.isdecimal() else []
            chosen = chosen or [channel for channel in channels if channel.name == wanted]
            if len(chosen) != 1:
                many = "several have this name, choose by number" if chosen else "not there"
                raise ValueError(f"channel {wanted}: {many}; allowed: {names}")
        part = chosen[0].lines
        return [line if part.start <= j < part.stop else "" for j, line in enumerate(lines)]

    def _lines_of_head(self, _, skip):
        """How many lines at the head of a text are none of the array: those to skip, or known ones."""
        return skip

    def __getstate__(self):
        """What is pickled: the array, where it is a dataset of an open file, which cannot be."""
        state = self.__dict__.copy()
        for name in {"_rows", "_written"} & state.keys():
            state[name] = np.asarray(state[name])
        return state

    @property
    def shape(self):
        """Shape ``(ny, nx)`` of the array."""
        return tuple(self._rows.shape)

    def rows(self, rows=slice(None)):
        """Return some rows as float64. Not collective."""
        check_fits(8 * self.shape[1] * len(range(*rows.indices(self.shape[0]))), f"{self.what} {self.file}")
        return np.array(self._rows[rows], dtype=np.float64, order="C")

    def check(self, rows):
        """Refuse values too large in some rows. Not collective."""
        refuse_large(f"{self.what} {self.file}", self.rows(rows), rows.start or 0)


def _decoded(content):
    """Text of a file: UTF-8; UTF-16 if it says so; else what Windows makes of a micro sign."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        coding = "utf-16"
    else:
        coding = "utf-8-sig"
    try:
        return content.decode(coding)
    except UnicodeDecodeError:
        strange = len(content) - len(content.translate(None, bytes(range(128, 256))))
        control = any(byte in content for byte in _NEVER)
        if coding == "utf-16" or control or strange > _STRANGE * len(content) + 8:
            raise NoText("it is no text; formats: .npy, .npz, .h5, .hdf5, and text") from None
        return content.decode("latin-1")
