"""Draw results, tables and surfaces: ``python -m app.plot FILE ... [-o DIR] [--only NAME]``.

A result has several figures (`app.plots.pictures.PICTURES`); a table of a sweep or load path has one, and so has a
measured surface. Several files have a folder DIR/NAME each, and their paths are drawn together in DIR/paths. The
command prints the names of the figures. Exit status 0, or 2 after an error. Runs on one rank.
"""

from pathlib import Path

from app.base import units
from app.base.errors import InputError
from app.cli import streams
from app.cli.arguments import (
    Parser,
    add_picture_options,
    argument_type,
    cell_size,
    check_folder,
    command,
    length_unit,
    picture_kinds,
)
from app.cli.problem_options import UNITS
from app.io.files import report_write_errors
from app.io.result import has_heights, read_result
from app.options.option_table import integer
from app.plots import heights, load_curves, style, sweeps
from app.plots.pictures import PICTURES, pictures_of
from app.problems.arrays import is_measured

_dots = integer(20, "a whole number from 20 to 1200", 1200)
# Maps of heights, except tables; a .csv is a map if --unit is given.
_MAPS = ".npy", ".npz", ".txt", ".dat", ".xyz", ".asc", ".md"


def save_pictures(pictures, folder, kinds=("png",), dpi=200, title=None):
    """Write pairs of name and figure to a folder; return their paths.

    `kinds` are the suffixes of the files. A `title` replaces the titles of the figures.
    """
    paths = []
    for name, figure in pictures:
        folder.mkdir(parents=True, exist_ok=True)
        if title:
            style.set_title(figure, title)
        for kind in kinds:
            paths.append(folder / f"{name}.{kind}")
            style.save_figure(figure, paths[-1], dpi)
    return paths


def _read(file, arguments):
    """Return a file's content: result, columns or surface.

    The best plane of a surface is subtracted.
    """
    suffix = file.suffix.lower()
    if not arguments.unit and load_curves.is_table(file):
        return load_curves.read_columns(file)
    if arguments.unit or suffix in _MAPS or has_heights(file):
        from app.cli.convert import set_units  # these load numba, which results do without
        from app.problems.surfaces.height_map import open_heights
        from app.problems.surfaces.reading import make_surface

        source = open_heights(file)
        set_units(source, arguments)
        return make_surface(source, level="plane")
    if arguments.spacing:
        raise InputError(f"--spacing: only for measured surfaces; {file} is none, or its --unit is missing")
    return read_result(file)


def _pictures(file, data, arguments):
    only, is_table = arguments.only, isinstance(data, dict)
    is_sweep, columns = is_table and "exit_status" in data, arguments.x or arguments.y
    if columns and not is_table:
        raise InputError(f"--x and --y choose columns of tables; {file} is none")
    if is_measured(data):
        yield "surface", heights.surface_figure(data)
    elif not is_table:
        figure = None
        for name, figure in pictures_of(data, only or PICTURES):
            yield name, figure
        if figure is None:
            raise InputError(f"--only {', '.join(only)}: result file {file} has nothing to draw for it")
    elif is_sweep or columns:
        figure = sweeps.sweep_figure(data, file.stem, arguments.x, arguments.y, UNITS)
        if figure is None:
            raise InputError(f"table {file}: nothing to draw: no option varies, or nothing measured does")
        yield "sweep" if is_sweep else "path", figure
    else:
        yield "path", load_curves.path_figure([load_curves.get_csv_path(data)], file.stem)


def _get_path(data, name):
    if isinstance(data, dict):
        return None if "exit_status" in data else load_curves.get_csv_path(data, name)
    return None if is_measured(data) else load_curves.get_path(data, name)


def _arguments(argv):
    parser = Parser(prog="python -m app.plot", description="Draw results, tables and measured surfaces.")
    add, elsewhere = parser.add_argument, "of a surface, if not stated in the file"
    files = "results (.h5), tables (.csv, .md, .txt, .h5), measured surfaces (.h5 of app.convert, .npy, text)"
    against = (
        "column of a table to draw against; default: the option with the most values, of a path the load"
    )
    column = (
        "column of a table to draw; may be repeated; default: those of physics, and work where solvers vary"
    )
    folder = "folder to write to; default: next to the file, with its name"
    only = f"draw only this picture of a result: {', '.join(PICTURES)}, or a field; may be repeated"
    dots = "pixels per inch, 20 to 1200; default: 200"
    add("files", type=Path, nargs="+", metavar="FILE", help=files)
    add("-o", "--output", type=Path, metavar="DIR", help=folder)
    add("--only", action="append", metavar="NAME", help=only)
    add("--x", metavar="NAME", help=against)
    add("--y", action="append", default=[], metavar="NAME", help=column)
    add("--unit", type=length_unit, help=f"{units.ALLOWED}: unit of the heights {elsewhere}")
    add("--spacing", type=cell_size, metavar="DX,DY", help=f"size of a cell [mm] {elsewhere}")
    add_picture_options(add)
    add("--dpi", type=argument_type(_dots), default=200, help=dots)
    arguments = parser.parse_args(argv)
    first = arguments.files[0]
    default = first.parent if arguments.files[1:] else first.parent / first.stem
    arguments.output = arguments.output or default
    check_folder(arguments.output)
    arguments.names = _choose_names(arguments.files)
    return arguments


def _choose_names(files):
    candidates = [
        (file.stem, name := f"{file.stem}_{file.suffix[1:]}", f"{file.absolute().parent.name}_{name}")
        for file in files
    ]
    chosen = []
    for names in candidates:
        unique = [name for k, name in enumerate(names) if sum(name == other[k] for other in candidates) == 1]
        if not unique:
            raise InputError(f"files: two are named {names[0]}; each needs a folder of its own name")
        chosen.append(unique[0])
    return chosen


def _draw_all(arguments):
    how = picture_kinds(arguments), arguments.dpi, arguments.title
    several = len(arguments.files) > 1
    for file in arguments.files[1:]:  # find errors before anything is written
        next(_pictures(file, _read(file, arguments), arguments))
    paths, drawn = [], []
    for file, name in zip(arguments.files, arguments.names, strict=True):
        data = _read(file, arguments)
        folder = arguments.output / name if several else arguments.output
        drawn += save_pictures(_pictures(file, data, arguments), folder, *how)
        path = _get_path(data, name)
        paths += [path] if path else []
    if len(paths) > 1:
        drawn += save_pictures([("paths", load_curves.path_figure(paths))], arguments.output, *how)
    return drawn


@command
def main(argv):
    """Run the command and return its exit status."""
    arguments = _arguments(argv)
    with report_write_errors(f"-o {arguments.output}"), style.use_style(arguments.style):
        drawn = _draw_all(arguments)
    streams.print_output("\n".join(map(str, drawn)))
    return 0
