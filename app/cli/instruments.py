"""Read an instrument's file by SurfaceTopography, which needs a newer numpy.

`app.convert` runs this file as a program in another environment, so it imports nothing of the project::

    .venv-surfaces/bin/python -P app/cli/instruments.py FILE OUT.npz [CHANNEL]

The program writes heights (ny, nx) in the instrument's unit, NaN for missing points, and facts as JSON. After an error
the exit status is 2, and standard error has one line.
"""

import gzip
import json
import re
import sys
import warnings
import zipfile
from functools import partial
from typing import NamedTuple

# Channels that are no heights, even if their unit is a length.
_NO_HEIGHT = re.compile("phase|amplitude|deflection|friction|lateral|current|intensity|error", re.IGNORECASE)
_NO_SIGNATURE = {"hgt", "nms"}  # formats that SurfaceTopography detects in any file of a suitable size
_UNKNOWN = "is in no format that SurfaceTopography knows"
_INDEXES = {"index.json", "meta.yml"}  # of contact.engineering's archives


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
    topography, sized = channel.read()
    if topography.dim != 2:
        raise ValueError(f"channel {channel.name} is a line, no map of heights")
    heights = np.ma.filled(np.ma.asarray(topography.heights(), float), np.nan)
    nx, ny = topography.nb_grid_pts
    lx, ly = topography.physical_sizes
    return np.ascontiguousarray(heights.T), {
        "unit": "Å" if topography.unit == "A" else topography.unit,
        "spacing": [float(lx) / nx, float(ly) / ny] if sized else None,
        "channel": channel.name,
        "format": kind,
    }


def _channels(path):
    """Return the channels of a file, and the name of its format."""
    from SurfaceTopography.IO import open_topography

    source = gzip.open(path) if path.lower().endswith(".gz") else path  # noqa: SIM115: the reader's own
    reader = open_topography(source)
    if reader.format() in _NO_SIGNATURE and f".{reader.format()}" not in path.lower():
        raise ValueError(_UNKNOWN)
    return [_channel(channel) for channel in reader.channels], reader.format()


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
        if not _INDEXES & set(archive.namelist()):
            raise ValueError("is no archive of contact.engineering: unpack it")
    # Prefer the archive's own file of a measurement to the instrument's.
    reader = open_container(path, format="ce", datafile_keys=["squeezed-netcdf", "original"])
    channels = []
    for k in range(reader.nb_containers):
        surface = reader.container(k)
        for j, member in enumerate(reader.members(k)):
            sides = getattr(member.metadata, "size", (1, 1))
            read = partial(_read_member, surface, j)
            channels.append(Channel(len(channels), member.name, len(sides) == 2, read))
    return channels, reader.format()


def _read_member(surface, number):
    return surface[number], True


def choose_channel(channels, wanted):
    """Return the channel with the name or number `wanted`."""
    maps = [channel for channel in channels if channel.has_heights]
    names = ", ".join(f"{channel.index} {channel.name}" for channel in maps)
    if not maps:
        others = ", ".join(channel.name for channel in channels)
        raise ValueError(f"has no channel of heights, only {others or 'none at all'}")
    if not wanted:
        if len(maps) > 1:
            raise ValueError(f"has several channels of heights; choose one by --channel: {names}")
        return maps[0]
    matching = [channel for channel in channels if str(channel.index) == wanted]
    matching = matching or [channel for channel in channels if channel.name == wanted]
    heights = [channel for channel in matching if channel.has_heights]
    if len(heights) != 1:
        several = "several have this name, choose by number"
        reason = several if heights else "it is no map of heights" if matching else "there is none"
        raise ValueError(f"--channel {wanted}: {reason}; allowed: {names}")
    return heights[0]


def main(path, output, wanted=""):
    """Write heights and facts of a channel; return the exit status."""
    import numpy as np

    warnings.simplefilter("ignore")
    try:
        heights, facts = read_heights(path, wanted)
    except Exception as error:  # of any reader
        name = type(error).__name__
        # This error quotes forty readers.
        text = _UNKNOWN if name == "CannotDetectFileFormat" else " ".join(str(error).split()) or name
        print(text, file=sys.stderr)
        return 2
    np.savez(output, heights=heights, facts=json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
