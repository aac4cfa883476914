"""Heights in a format of an instrument, by SurfaceTopography, which needs a newer numpy than the rest.

Run by `app.convert` as a program in an environment of its own; knows nothing of the project::

    .venv-surfaces/bin/python -P app/cli/instruments.py FILE OUT.npz [CHANNEL]

Writes heights (ny, nx) in the instrument's unit with NaN for missing points, and facts as JSON. Exit status 2: one line
on standard error says why not.
"""

import gzip
import json
import re
import sys
import warnings
import zipfile
from typing import NamedTuple

# Channels that are no heights, in whatever unit: amplitude and deflection may be lengths.
_NO_HEIGHT = re.compile("phase|amplitude|deflection|friction|lateral|current|intensity|error", re.IGNORECASE)
_NO_MARK = {"hgt", "nms"}  # formats that any file of a suitable size seems to have
_UNKNOWN = "is in no format that SurfaceTopography knows"
_INDEXES = {"index.json", "meta.yml"}  # of contact.engineering's archives


class Channel(NamedTuple):
    """A channel or measurement of a file: its number and name, if it has heights, and a function that reads it."""

    index: int
    name: str
    has_heights: bool
    read: object


def read_heights(path, wanted):
    """Return heights (ny, nx), NaN where missing, and facts, of a channel by name or number; "": the only one."""
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
    """Return the channels of a file and its format."""
    from SurfaceTopography.IO import open_topography

    source = gzip.open(path) if path.lower().endswith(".gz") else path  # noqa: SIM115: the reader's own
    reader = open_topography(source)
    if reader.format() in _NO_MARK and f".{reader.format()}" not in path.lower():
        raise ValueError(_UNKNOWN)
    return [_channel(channel) for channel in reader.channels], reader.format()


def _channel(channel):
    def read():
        if channel.dim != 2:
            raise ValueError(f"channel {channel.name} is a line, no map of heights")
        sizes = channel.physical_sizes
        how = {"physical_sizes": channel.nb_grid_pts} if sizes is None else {}
        return channel.topography(**how), sizes is not None

    # Where the unit of heights is another quantity, SurfaceTopography gives a pair of units.
    length = channel.is_height_channel and not isinstance(channel.unit, tuple)
    name = str(channel.name)
    return Channel(channel.index, name, length and not _NO_HEIGHT.search(name), read)


def _archive(path):
    """Return the measurements in an archive of contact.engineering and its format."""
    from SurfaceTopography.Container.IO import open_container

    with zipfile.ZipFile(path) as archive:
        if not _INDEXES & set(archive.namelist()):
            raise ValueError("is no archive of contact.engineering: unpack it")
    # The archive's own file of a measurement is preferred to the instrument's.
    reader = open_container(path, format="ce", datafile_keys=["squeezed-netcdf", "original"])
    found = []
    for k in range(reader.nb_containers):
        surface = reader.container(k)
        for j, member in enumerate(reader.members(k)):
            sides = getattr(member.metadata, "size", (1, 1))
            found.append(
                Channel(len(found), member.name, len(sides) == 2, lambda s=surface, j=j: (s[j], True))
            )
    return found, reader.format()


def choose_channel(channels, wanted):
    """Return the channel of heights that has a name or a number; "": the only one."""
    maps = [channel for channel in channels if channel.has_heights]
    names = ", ".join(f"{channel.index} {channel.name}" for channel in maps)
    if not maps:
        others = ", ".join(channel.name for channel in channels)
        raise ValueError(f"has no channel of heights, only {others or 'none at all'}")
    if not wanted:
        if len(maps) > 1:
            raise ValueError(f"has several channels of heights; choose one by --channel: {names}")
        return maps[0]
    found = [channel for channel in channels if str(channel.index) == wanted]
    found = found or [channel for channel in channels if channel.name == wanted]
    heights = [channel for channel in found if channel.has_heights]
    if len(heights) != 1:
        several = "several have this name, choose by number"
        what = several if heights else "it is no map of heights" if found else "there is none"
        raise ValueError(f"--channel {wanted}: {what}; allowed: {names}")
    return heights[0]


def main(path, output, wanted=""):
    """Write the file; return the exit status."""
    import numpy as np

    warnings.simplefilter("ignore")
    try:
        heights, facts = read_heights(path, wanted)
    except Exception as error:  # whatever a reader meets in a file
        text = " ".join(str(error).split()) or type(error).__name__
        if type(error).__name__ == "CannotDetectFileFormat":  # and what each of forty readers says
            text = _UNKNOWN
        print(text, file=sys.stderr)
        return 2
    np.savez(output, heights=heights, facts=json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
