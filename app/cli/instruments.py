"""Read an instrument's file by SurfaceTopography, which needs a newer numpy.

`app.convert` runs this file as a program in another environment, so it imports nothing of the project::

    .venv-surfaces/bin/python -P app/cli/instruments.py FILE OUT.npz [CHANNEL]

The program writes heights (ny, nx) in the instrument's unit, NaN for missing points, and facts as JSON. After an error
standard error has one line, and the exit status is 2, or `FAULTY` if a reader knows the format.
"""

import gzip
import json
import re
import struct
import sys
import textwrap
import warnings
import zipfile
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

FAULTY = 3  # exit status
# Channels that are no heights, even if their unit is a length.
_NO_HEIGHT = re.compile("phase|amplitude|deflection|friction|lateral|current|intensity|error", re.IGNORECASE)
_NO_SIGNATURE = {"hgt", "nms", "mat"}  # formats whose readers accept other files of a suitable size
_ARRAYS = {"h5", "npy", "npz"}  # arrays of any kind, which the program reads itself
_TEXTS = {"asc", "xyz"}  # many programs write texts with their endings
_SUR_TYPES = {  # objects of Digital Surf that are no single map of heights
    3: "a binary image", 4: "a series of profiles", 5: "a series of surfaces", 7: "a profile of several layers",
    8: "a surface of several layers", 10: "an image of intensities", 12: "an image of colours",
}  # fmt: skip
_HDF5 = "is HDF5 of no known instrument: end its name in .h5, and name a data set of heights as FILE:/DATASET"
_UNKNOWN = "is in no format that SurfaceTopography knows"
_INDEXES = {"index.json", "meta.yml"}  # of contact.engineering's archives


class FaultyFile(ValueError):
    """Error for a file in a known format, or for a channel that it does not have."""


class Channel(NamedTuple):
    """Channel or measurement of a file.

    The function ``read()`` returns its topography, and whether the file states the sides of the patch.
    """

    index: int
    name: str
    has_heights: bool
    read: object


def read_heights(path, wanted):
    """Return heights (ny, nx) and facts of a channel of a file.

    `wanted` is the name or number of the channel; an empty text means the only channel. Missing heights are NaN. The
    facts are unit, spacing, channel and format.
    """
    import numpy as np

    channels, kind = _archive(path) if path.lower().endswith(".zip") else _channels(path)
    channel = choose_channel(channels, wanted)
    try:
        topography, sized = channel.read()
    except Exception as error:
        raise FaultyFile(f"as {kind.upper()}: {_one_line(error)}") from None
    if topography.dim != 2:
        raise ValueError(f"channel {channel.name} is a line, no map of heights")
    heights = np.ma.filled(np.ma.asarray(topography.heights(), float), np.nan)
    if kind == "nms":  # 65534 steps from least to largest height; number 65535 marks a missing point
        low, high = struct.unpack("<2d", _read_start(path)[16:32])
        heights[heights > high + (high - low) / 2**17] = np.nan
    nx, ny = topography.nb_grid_pts
    lx, ly = topography.physical_sizes
    return np.ascontiguousarray(heights.T), {
        "unit": "Å" if topography.unit == "A" else topography.unit,
        "spacing": [float(lx) / nx, float(ly) / ny] if sized else None,
        "channel": channel.name,
        "format": kind,
    }


def _channels(path):
    """Return the channels of a file, and the name of its format.

    Readers of the file's ending come first. A file that such a reader knows, or that begins as a reader's format does,
    is left to no other reader, which might find numbers in it by chance. A reader without channels of heights leaves
    the file to the next one. Raises ValueError, with the faults that readers of this format have found.
    """
    from SurfaceTopography.Exceptions import FileFormatMismatch
    from SurfaceTopography.IO import MagicMatch, open_topography, readers

    packed = path.lower().endswith(".gz")
    ending = path.lower().removesuffix(".gz").rpartition(".")[2]
    start = _read_start(path)
    known = [reader for reader in readers if reader.format() not in _ARRAYS]
    own = [reader for reader in known if ending in reader.file_extensions() and reader.format() not in _TEXTS]
    others = [reader for reader in known if reader not in own and reader.format() not in _NO_SIGNATURE]
    matches = [(reader, reader.can_read(start)) for reader in (*own, *others)]
    certain = [reader for reader, match in matches if match == MagicMatch.YES]
    candidates = certain or [reader for reader, match in matches if match == MagicMatch.MAYBE]
    faults, empty, refusal = [], None, ValueError
    for reader in candidates:
        source = gzip.open(path) if packed else path  # noqa: SIM115: the reader's own
        kind = reader.format()
        try:
            channels = [_channel(channel) for channel in open_topography(source, kind).channels]
        except Exception as error:
            mismatch = isinstance(error, FileFormatMismatch)
            if reader in own or reader in certain:
                faults.append(f"{'no' if mismatch else 'as'} {kind.upper()}: {_one_line(error)}")
                if not mismatch:
                    refusal = FaultyFile
                    break
            continue
        if kind == "sur" and start[18] in _SUR_TYPES:
            raise FaultyFile(f"as SUR: is {_SUR_TYPES[start[18]]}: export one surface")
        if any(channel.has_heights for channel in channels):
            return channels, kind
        empty = empty or (channels, kind)
    if faults or not empty:
        raise refusal("; ".join(faults) or (_HDF5 if start.startswith(b"\x89HDF") else _UNKNOWN))
    return empty


def _read_start(path):
    """Return the first 512 bytes of a file, which may be compressed."""
    with gzip.open(path) if path.lower().endswith(".gz") else Path(path).open("rb") as file:
        return file.read(512)


def _one_line(error):
    return textwrap.shorten(str(error) or type(error).__name__, 300)


def _channel(channel):
    def read():
        if channel.dim != 2:
            raise ValueError(f"channel {channel.name} is a line, no map of heights")
        sizes = channel.physical_sizes
        arguments = {"physical_sizes": channel.nb_grid_pts} if sizes is None else {}
        return channel.topography(**arguments), sizes is not None

    # A pair of units means that heights have another unit than lengths.
    length = channel.is_height_channel and not isinstance(channel.unit, tuple)
    name = str(channel.name)
    return Channel(channel.index, name, length and not _NO_HEIGHT.search(name), read)


def _archive(path):
    """Return the measurements in an archive of contact.engineering.

    Return also the name of its format.
    """
    from SurfaceTopography.Container.IO import open_container

    with zipfile.ZipFile(path) as archive:
        indexed = _INDEXES & set(archive.namelist())
    if not indexed:
        with suppress(ValueError):
            return _channels(path)
        raise ValueError("is no archive of contact.engineering: unpack it")
    # Prefer the archive's own file of a measurement to the instrument's.
    try:
        reader = open_container(path, format="ce", datafile_keys=["squeezed-netcdf", "original"])
    except Exception as error:
        raise FaultyFile(f"as CE: {_one_line(error)}") from None
    channels = []
    for k in range(reader.nb_containers):
        surface = reader.container(k)
        for j, member in enumerate(reader.members(k)):
            sides = getattr(member.metadata, "size", (1, 1))
            read = partial(_read_member, surface, j)
            channels.append(Channel(len(channels), member.name, len(sides) == 2, read))
    return channels, reader.format()


def _read_member(surface, number):
    from SurfaceTopography.Exceptions import CannotDetectFileFormat

    try:
        return surface[number], True
    except CannotDetectFileFormat as error:  # quotes forty readers
        missing = re.search(r"There is no item named ('[^']*')", str(error))
        reason = f"lacks the file {missing[1]}, which has the heights" if missing else f"its file {_UNKNOWN}"
        raise ValueError(reason) from None


def choose_channel(channels, wanted):
    """Return the channel with the name or number `wanted`."""
    maps = [channel for channel in channels if channel.has_heights]
    names = ", ".join(f"{channel.index} {channel.name}" for channel in maps)
    if not maps:
        others = ", ".join(channel.name for channel in channels)
        raise ValueError(f"has no channel of heights, only {others or 'none at all'}")
    if not wanted:
        if len(maps) > 1:
            raise FaultyFile(f"has several channels of heights; choose one by --channel: {names}")
        return maps[0]
    matching = [channel for channel in channels if str(channel.index) == wanted]
    matching = matching or [channel for channel in channels if channel.name == wanted]
    heights = [channel for channel in matching if channel.has_heights]
    if len(heights) != 1:
        several = "several have this name, choose by number"
        reason = several if heights else "it is no map of heights" if matching else "there is none"
        raise FaultyFile(f"--channel {wanted}: {reason}; allowed: {names}")
    return heights[0]


def main(path, output, wanted=""):
    """Write heights and facts of a channel; return the exit status."""
    import numpy as np

    warnings.simplefilter("ignore")
    try:
        heights, facts = read_heights(path, wanted)
    except Exception as error:  # of any reader
        print(_one_line(error), file=sys.stderr)
        return FAULTY if isinstance(error, FaultyFile) else 2
    np.savez(output, heights=heights, facts=json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
