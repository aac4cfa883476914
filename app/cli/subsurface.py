"""Stress below a contact: ``python -m app.subsurface RESULT.h5 [--poisson NU] [-o DIR]``, or `stress` from Python.

The command finds the largest von Mises stress and the largest shear stress, and prints them. With -o it writes
DIR/subsurface.png, the von Mises stress on a vertical section and the stresses on the line through its largest (or
through ``--at``), and DIR/subsurface.h5: all six components, the von Mises stress and the largest shear stress on the
section along x and on the one along y, on the line, and on the horizontal planes asked for by ``--planes``, [N/mm2],
compression negative. Exit status 0, or 2 with one line on standard error. Runs on one rank.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from app.base.errors import InputError
from app.base.units import choose_length_unit
from app.cli import streams
from app.cli.arguments import Parser, argument_type, check_folder, command, count, report_write_errors
from app.halfspace.stress.subsurface import COMPONENTS, StressMaximum, SubsurfaceStress, max_shear, von_mises
from app.io.files import atomic_hdf5, check_output_path
from app.io.result import read_result
from app.options.option_table import half, integer, pair_of_reals, real
from app.plots import curves, figures, style

_DEEP = 4.0  # sections reach to so many times the depth of the largest stress
_point = pair_of_reals("X,Y, two finite numbers [mm]")
_body = integer(1, "1 or 2", 2)
_depth = real("one positive number [mm]", above=0)
_each_depth = real("numbers from 0 [mm], with commas between", lowest=0)


def _depths(text):
    return tuple(map(_each_depth, text.split(",")))


def stress(solution, poisson_ratio=None, body=None):
    """Stress in one of the two bodies below a solution.

    Not collective: for a solution on several ranks call it on one, with ``solution.gather()``.

    Parameters
    ----------
    solution : Solution or Result
        As `app.solve` returns it, or `app.read_result`.
    poisson_ratio : float, optional
        Of the body looked at; default: what the problem says.
    body : int, optional
        1 or 2, where the problem knows both bodies; default: the first that is not rigid.

    Returns
    -------
    SubsurfaceStress
        Has `plane`, `section`, `line`, `maximum` and `maxima`.

    Raises
    ------
    InputError
        If Poisson's ratio is unknown or not allowed, or the solution is none, or has the rows of one rank only.

    Examples
    --------
    >>> from app import ContactProblem, Grid, Material, solve
    >>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / 40)
    >>> hottest = stress(solve(sphere, approach=0.02)).maximum()
    >>> round(hottest.depth, 1)  # 0.48 radii of the contact
    0.3
    """
    if not hasattr(solution, "pressure"):
        raise InputError(
            f"stress: is {type(solution).__name__}; needed: a Solution, or read_result(FILE) of a result file"
        )
    grid, facts = solution.grid, solution.attributes
    if poisson_ratio is None:
        poisson_ratio = find_poisson_ratio(facts, body)
    elif body is not None:
        raise InputError("body: has no effect with a Poisson ratio")
    if poisson_ratio is None:
        raise InputError(
            "Poisson's ratio of the body is not known: the material was given by its contact modulus alone; "
            "needed: poisson_ratio= (--poisson NU)"
        )
    if solution.pressure.shape != grid.shape:
        raise InputError("solution: has the rows of one rank; needed: solution.gather() on one rank")
    return SubsurfaceStress(solution.pressure, grid, poisson_ratio)


def find_poisson_ratio(facts, body=None):
    """Poisson's ratio of a body as the attributes of a result tell it, None if they do not."""
    if body not in (None, 1, 2):
        raise InputError(f"body {body!r}: allowed: 1, 2")
    each = np.atleast_1d(facts["poisson"]) if "poisson" in facts else ()
    if len(each) == 2:
        if body is None:
            young = np.atleast_1d(facts.get("young", (1.0, 1.0)))
            body = 1 if np.isfinite(young[0]) else 2
        return float(each[body - 1])
    if body is not None:
        raise InputError(f"body {body}: the material of the pair was given, not those of the bodies")
    return facts.get("poisson_ratio")


def survey(below, depths=64, at=None, deepest=None, along="xy"):
    """Largest stress, sections and line through it.

    Not collective.

    Parameters
    ----------
    below : SubsurfaceStress
    depths : int
        Of sections and line.
    at : (float, float), optional
        Point (x, y) [mm] that these go through, if not the most stressed one.
    deepest : float, optional
        Last depth [mm]; default: some times that of the largest stress.
    along : str
        Directions of the sections wanted: "xy", "x" or "y".

    Returns
    -------
    SimpleNamespace
        `hottest` (where the von Mises stress is largest), `sheared` (where the shear stress is), `at` (the largest of
        the line), `depths`, `section_x`, `section_y` (6, depths, nx or ny) or None, `line` (6, depths).
    """
    hottest, sheared = below.maxima()
    x, y = at or (hottest.x, hottest.y)
    cell = max(below.grid.dx, below.grid.dy)
    depths = np.linspace(0.0, deepest or max(_DEEP * hottest.depth, 4 * cell), depths)
    line = below.line(depths, x, y)
    here = hottest
    if at is not None:
        k = int(np.argmax(von_mises(line)))
        here = StressMaximum(float(von_mises(line)[k]), x, y, float(depths[k]), line[:, k])
    along_x = below.section(depths, y=y) if "x" in along else None
    along_y = below.section(depths, x=x) if "y" in along else None
    return SimpleNamespace(
        hottest=hottest,
        sheared=sheared,
        at=here,
        depths=depths,
        section_x=along_x,
        section_y=along_y,
        line=line,
        poisson_ratio=below.nu,
    )


def draw(result, found, along="x"):
    """Figure of a survey. Not collective."""
    section = found.section_x if along == "x" else found.section_y
    heading = f"{figures.make_title(result)}, ν = {found.poisson_ratio:.3g}"
    return curves.stress_figure(along, result.grid, found.depths, section, found.line, found.at, heading)


def write(path, result, found, planes):
    """HDF5 file of a survey and of some planes (depth -> stress); whole or not at all. Not collective."""
    with atomic_hdf5(path) as file:
        at = found.at
        for name, values in (("x", result.x), ("y", result.y), ("depth", found.depths)):
            file[name] = values
            file[name].attrs["unit"] = "mm"
            file[name].make_scale(name)
        file.attrs.update(poisson_ratio=found.poisson_ratio, x=at.x, y=at.y)
        for name, there in (("von_mises", found.hottest), ("max_shear", found.sheared)):
            largest = f"max_{name.removeprefix('max_')}"
            file.attrs[largest] = getattr(there, name)
            file.attrs.update({f"{largest}_{where}": getattr(there, where) for where in ("x", "y", "depth")})
        groups = {
            "section_x": (found.section_x, ("depth", "x")),
            "section_y": (found.section_y, ("depth", "y")),
        }
        groups["line"] = found.line, ("depth",)
        for number, (depth, plane) in enumerate(planes.items()):
            groups[f"plane_{number}"] = plane, ("y", "x")
            file.create_group(f"plane_{number}").attrs["depth"] = depth
        for group, (values, axes) in groups.items():
            fields = {f"sigma_{name}": part for name, part in zip(COMPONENTS, values, strict=True)}
            fields |= {"von_mises": von_mises(values), "max_shear": max_shear(values)}
            for name, field in fields.items():
                item = file.create_dataset(f"{group}/{name}", data=field)
                item.attrs["unit"] = "N/mm2"
                for dimension, axis in zip(item.dims, axes, strict=True):
                    dimension.attach_scale(file[axis])


def add_body(add):
    """Arguments that say below the surface of which body to look: ``add`` is that of the command's parser."""
    add(
        "--poisson",
        type=argument_type(half),
        metavar="NU",
        help="of the body, 0 to 0.5; default: the result's",
    )
    add("--body", type=argument_type(_body), metavar="K", help="1 or 2, where the result knows both bodies")


def _arguments(argv):
    parser = Parser(prog="python -m app.subsurface", description="Stress below the contact of a result file.")
    add, through = parser.add_argument, "sections go through here [mm]; default: the largest stress"
    deepest = "last depth [mm]; default: 4 times that of the largest stress"
    planes = "depths of horizontal planes [mm]"
    add("result", type=Path, metavar="RESULT.h5", help="result file of app.solve")
    add("-o", "--output", type=Path, metavar="DIR", help="folder for subsurface.h5 and the picture")
    add_body(add)
    add("--at", type=argument_type(_point), metavar="X,Y", help=through)
    add("--section", choices=("x", "y"), default="x", help="direction of the picture's; default: x")
    add("--depths", type=count, default=64, metavar="N", help="number of depths; default: 64")
    add("--deepest", type=argument_type(_depth), metavar="Z", help=deepest)
    add("--planes", type=argument_type(_depths), default=(), metavar="Z1,Z2", help=planes)
    add("--format", choices=("png", "pdf", "svg"), default="png", help="default: png")
    arguments = parser.parse_args(argv)
    if arguments.output is not None:
        check_folder(arguments.output)
    else:
        of_files = ("at", "section", "depths", "deepest", "planes", "format")
        given = [f"--{name}" for name in of_files if getattr(arguments, name) != parser.get_default(name)]
        if given:
            raise InputError(f"{', '.join(given)}: no effect without -o DIR")
    return arguments


def summary(hottest, sheared, result, poisson_ratio):
    """What was found, a text of two lines for each of `SubsurfaceStress.maxima`. Not collective."""
    highest = float(np.nanmax(result.pressure))
    each = np.atleast_1d(result.attributes.get("poisson", ()))
    of = (
        [f" (body {k})" for k, nu in enumerate(each, 1) if nu == poisson_ratio] if len(set(each)) == 2 else []
    )
    # No place is more stressed than others without a pressure, nor below one that is the same all over.
    variation = np.ptp(result.pressure)
    uniform = highest <= 0 or (result.grid.periodic and variation <= curves.MIN_STRESS_VARIATION * highest)
    texts = []
    for name, value, there in (
        ("von Mises", hottest.von_mises, hottest),
        ("shear", sheared.max_shear, sheared),
    ):
        unit = choose_length_unit(there.depth or float(np.ptp(result.x)))
        share = f", {value / highest:.3g} of the maximum pressure" if highest > 0 else ""
        place = (
            f"x = {there.x:.6g} mm, y = {there.y:.6g} mm, depth {there.depth * unit.per_mm:.4g} {unit.name}"
        )
        texts.append(
            f"largest {name} stress {value:.6g} N/mm2{share}, for nu = {poisson_ratio:g}{''.join(of)}\n"
            f"  {'everywhere' if uniform else f'at {place}'}"
        )
    return texts


@command
def main(argv):
    """Run the command and return its exit status."""
    arguments = _arguments(argv)
    result = read_result(arguments.result)
    below = stress(result, arguments.poisson, arguments.body)
    if arguments.output is None:
        streams.print_output("\n".join(summary(*below.maxima(), result, below.nu)))
        return 0
    names = [arguments.output / f"subsurface.{kind}" for kind in ("h5", arguments.format)]
    if arguments.output.exists():
        for name in names:
            check_output_path(name, [arguments.result], "-o", (name.suffix,))
    found = survey(below, arguments.depths, arguments.at, arguments.deepest)
    planes = {depth: below.plane(depth) for depth in arguments.planes}
    figure = draw(result, found, arguments.section)
    with report_write_errors(arguments.output):
        arguments.output.mkdir(exist_ok=True)
        write(names[0], result, found, planes)
        style.save_figure(figure, names[1])
    streams.print_output(
        "\n".join([*summary(found.hottest, found.sheared, result, below.nu), *map(str, names)])
    )
    return 0
