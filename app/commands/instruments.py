"""Heights in a format of an instrument, by SurfaceTopography, which needs a newer numpy than the rest.

Run by `app.convert` as a program in an environment of its own; knows nothing of the project::

    .venv-surfaces/bin/python -P app/commands/instruments.py FILE OUT.npz [CHANNEL]

Writes heights (ny, nx) in the instrument's unit with NaN for missing points, and facts as JSON. Exit status 2: one line
on standard error says why not.
"""

import json
import sys
import warnings


def heights_of(path, wanted):
    """Return heights (ny, nx), NaN where missing, and facts, of a channel by name or number; "": the only one."""
    import numpy as np
    from SurfaceTopography.IO import open_topography

    with open_topography(path) as reader:
        channel = _channel(reader, wanted)
        if channel.dim != 2:
            raise ValueError(f"channel {channel.name} is a line, no map of heights")
        sizes = channel.physical_sizes
        topography = channel.topography(**({"physical_sizes": channel.nb_grid_pts} if sizes is None else {}))
        heights = np.ma.filled(np.ma.asarray(topography.heights(), float), np.nan)
        nx, ny = topography.nb_grid_pts
        lx, ly = topography.physical_sizes
        return np.ascontiguousarray(heights.T), {
            "unit": topography.unit,
            "spacing": None if sizes is None else [float(lx) / nx, float(ly) / ny],
            "channel": str(channel.name),
            "format": reader.format(),
        }


def _channel(reader, wanted):
    maps = [channel for channel in reader.channels if channel.is_height_channel]
    names = ", ".join(f"{channel.index} {channel.name}" for channel in maps)
    if not maps:
        raise ValueError("has no channel of heights")
    if not wanted:
        if len(maps) > 1:
            raise ValueError(f"has several channels of heights; choose one by --channel: {names}")
        return maps[0]
    found = [channel for channel in maps if wanted in (str(channel.index), str(channel.name))]
    if not found:
        raise ValueError(f"--channel {wanted}: there is none; allowed: {names}")
    return found[0]


def main(path, output, wanted=""):
    """Write the file; return the exit status."""
    import numpy as np

    warnings.simplefilter("ignore")
    try:
        heights, facts = heights_of(path, wanted)
    except Exception as error:  # whatever a reader meets in a file
        text = " ".join(str(error).split()) or type(error).__name__
        if type(error).__name__ == "CannotDetectFileFormat":  # and what each of forty readers says
            text = "is in no format that SurfaceTopography knows"
        print(text, file=sys.stderr)
        return 2
    np.savez(output, heights=heights, facts=json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
