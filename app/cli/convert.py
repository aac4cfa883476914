"""Convert a measured surface to HDF5: ``python -m app.convert FILE -o surface.h5``.

The dataset ``heights``, (ny, nx) float64, is NaN where a point is missing, and ``mask`` is 1 there. The first row is at
the smallest y. Attributes of ``heights``: ``unit``, ``spacing`` (dx, dy) and ``spacing_unit``. Root attributes:
``source`` (name of the file), ``sha256`` (hash of the file), ``format``, ``channel``, ``version``.
"""

import json
import os
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from app.base import units
from app.base.errors import InputError
from app.cli import streams
from app.cli.arguments import Parser, argument_type, cell_size, command, length_unit
from app.cli.instruments import FAULTY
from app.options.option_table import cells, integer, subset
from app.problems.surfaces.array_file import UnknownFormat
from app.problems.surfaces.formats import ARRAYS, TEXTS, detect_format, split_suffix
from app.problems.surfaces.height_map import TURNS, HeightMap, open_heights

ENVIRONMENT = "ELASTIC_CONTACT_SURFACES"  # variable with the path of a Python that has SurfaceTopography
_line_count = integer(0, "a whole number from 0")
_SHARED = ".stp", ".tif", ".tiff", ".xlsx"  # endings of instruments' files, and of others
_NAMES = "--unit", "--height-unit", "--spacing", "--override"


class _FaultyFile(InputError):
    """Error for a file in an instrument's format that cannot be read."""


def find_instruments_python():
    """Return a Python that has SurfaceTopography, or None.

    By default it is the Python that ``run/setup --surfaces`` installs.
    """
    path = os.environ.get(ENVIRONMENT) or Path(__file__).resolve().parents[2] / ".venv-surfaces/bin/python"
    path = Path(path)
    return path if path.is_file() else None


@command
def main(argv):
    """Run the command and return its exit status."""
    parser = Parser(prog="python -m app.convert", description="Convert a measured surface to HDF5.")
    add, elsewhere = parser.add_argument, "if not stated in the file"
    add("file", type=Path, metavar="FILE", help="instrument's file, .npy, .npz, .h5 or text")
    add("-o", "--output", type=Path, required=True, metavar="SURFACE.h5", help="file to write")
    add("--channel", default="", help="channel to read, if there are several: name or number from 0")
    add("--unit", type=length_unit, help=f"{units.ALLOWED}: unit of the heights, {elsewhere}")
    add("--height-unit", type=length_unit, help="unit of the heights, if it differs from that of x and y")
    how = "turns of the map: transpose, flip_x, flip_y, or several with commas between"
    lines = "lines to skip at the head of a text file"
    part = "columns I0 to I1 - 1, rows J0 to J1 - 1 only"
    add("--skip", type=argument_type(_line_count), default=0, metavar="N", help=lines)
    add("--orient", type=argument_type(subset(*TURNS)), default=(), metavar="HOW", help=how)
    add("--crop", type=argument_type(cells), metavar="I0,I1,J0,J1", help=part)
    add("--spacing", type=cell_size, metavar="DX,DY", help=f"size of a cell [mm], {elsewhere}")
    replaced = "--unit, --height-unit and --spacing replace the values stated in the file"
    add("--override", action="store_true", help=replaced)
    arguments = parser.parse_args(argv)
    from app.io.files import check_output_path, hash_file, report_write_errors
    from app.problems.surfaces.doubts import note_doubts
    from app.problems.surfaces.reading import make_surface

    path, file = arguments.file, _without_dataset(arguments.file)
    if not file.is_file():
        raise InputError(f"surface file {path}: {'not a file' if path.exists() else 'no such file'}")
    check_output_path(arguments.output, [path, file], "-o")
    source, origin = _read(path, arguments)
    if arguments.crop:
        source.crop(arguments.crop)
    set_units(source, arguments, arguments.height_unit, arguments.override)
    source.orient = ()  # the file has turned heights
    surface = make_surface(source)  # checks the heights
    with report_write_errors(f"-o {arguments.output}"):
        _write(arguments.output, source, {**origin, "source": file.name, "sha256": hash_file(file)})
    streams.print_output(f"{arguments.output}: {surface.understood()}")
    for note in note_doubts(surface, surface.grid()):
        streams.print_error(f"warning: {note}")
    return 0


def _without_dataset(path):
    return Path(str(path).partition(":/")[0])


def _read(path, arguments):
    """Return a file's `HeightMap`, format and channel."""
    channel, skip = arguments.channel, arguments.skip
    known = detect_format(_without_dataset(path), skip)
    if skip and known.kind == "instrument":
        raise InputError(f"--skip {skip}: allowed of {', '.join(TEXTS)}")
    if known.kind == "instrument":
        return _make_map(path, *_read_instruments(path, channel), arguments)
    if split_suffix(path)[0] in _SHARED and find_instruments_python():
        try:
            return _make_map(path, *_read_instruments(path, channel), arguments)
        except InputError as error:
            if isinstance(error, _FaultyFile):
                raise
    try:
        source = open_heights(path, skip, arguments.orient, channel, coordinates=bool(arguments.crop))
    except UnknownFormat as error:
        if skip or (error.is_text and not find_instruments_python()):
            raise
        if not error.is_text:
            return _make_map(path, *_read_instruments(path, channel), arguments)
        facts = {}
        with suppress(InputError):
            heights, facts = _read_instruments(path, channel)
        # SurfaceTopography finds numbers in texts of any format.
        if not (facts.get("unit") and facts.get("spacing")):
            raise  # its own message would say less
        return _make_map(path, heights, facts, arguments)
    return source, {"format": split_suffix(_without_dataset(path))[0][1:], "channel": channel}


def _read_instruments(path, channel):
    python = find_instruments_python()
    if python is None:
        raise InputError(
            f"surface file {path}: formats of instruments need SurfaceTopography: run/setup --surfaces installs it in "
            f"an environment of its own; read without: {', '.join((*ARRAYS, *TEXTS))}"
        )
    import numpy as np

    worker = Path(__file__).with_name("instruments.py")
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder, "heights.npz")
        process = subprocess.run(
            [python, "-P", worker, path, output, channel], env=environment, stdin=subprocess.DEVNULL,
            capture_output=True, encoding="utf-8", errors="replace", check=False,
        )  # fmt: skip
        if process.returncode or not output.exists():
            errors = process.stderr.strip().splitlines() or ["its reader died"]
            refusal = _FaultyFile if process.returncode == FAULTY else InputError
            raise refusal(f"surface file {path}: cannot be read: {errors[-1]}")
        with np.load(output) as arrays:
            heights, facts = arrays["heights"], json.loads(str(arrays["facts"]))
    if not heights.size:
        raise InputError(f"surface file {path}: cannot be read: it is empty")
    return heights, facts


def _make_map(path, heights, facts, arguments):
    """Return an instrument file's `HeightMap`, format and channel.

    `heights` and `facts` are what `app.cli.instruments` has read from the file.
    """
    unit = units.find_unit(facts["unit"])
    other = None if unit else facts["unit"]
    source = HeightMap(str(path), heights, arguments.orient, facts["spacing"], unit, other_unit=other)
    return source, {name: facts[name] for name in ("format", "channel")}


def set_units(source, arguments, height_unit=None, override=False):
    """Set a `HeightMap`'s unit and spacing.

    Raises InputError if neither file nor options state unit and spacing, or if both do.
    """
    source.settle(arguments.unit, height_unit, arguments.spacing, override, _NAMES)
    if source.spacing is None:
        raise InputError(
            f"--spacing is missing: surface file {source.file} does not say the size DX,DY of its cells [mm]"
        )


def _write(output, source, origin):
    import numpy as np

    from app import __version__
    from app.io.files import atomic_hdf5

    heights = source.rows()
    with atomic_hdf5(output) as file:
        dataset = file.create_dataset("heights", data=heights)
        spacing = np.asarray(source.spacing, float)
        dataset.attrs.update(unit=source.unit, spacing=spacing, spacing_unit=source.lateral)
        file["mask"] = np.isnan(heights).astype(np.uint8)
        file.attrs.update(origin, version=__version__)
