"""Print and draw the stress below a contact: ``python -m app.subsurface RESULT.h5 [-o DIR]``.

The command prints the largest stresses. With -o it draws DIR/subsurface.png, and writes DIR/subsurface.h5: six stress
components, von Mises and largest shear stress on sections, a line and planes [N/mm2], compression negative. Sections of
a coated body have both sides of the interface. Exit status 0, or 2 after an error. Runs on one rank.
"""

from pathlib import Path

import numpy as np

from app.api.subsurface import stress, survey
from app.base.errors import InputError
from app.base.units import choose_length_unit
from app.cli import streams
from app.cli.arguments import (
    Parser,
    add_picture_options,
    argument_type,
    check_folder,
    command,
    count,
    picture_kinds,
)
from app.halfspace.stress.subsurface import COMPONENTS, max_shear, von_mises
from app.io.files import atomic_hdf5, check_output_path, report_write_errors
from app.io.result import read_result
from app.io.write import create_axes, create_field
from app.options.option_table import half, integer, lengths, pair_of_reals, real
from app.plots import figures, style
from app.plots.stress import MIN_STRESS_VARIATION, stress_figure

_point = lengths(pair_of_reals("X,Y, two finite numbers [mm]"))
_body = integer(1, "1 or 2", 2)
_depth = lengths(real("one positive number [mm]", above=0))
_each_depth = real("numbers from 0 [mm], with commas between", lowest=0)


@lengths
def _depths(text):
    return tuple(map(_each_depth, text.split(",")))


def draw(result, stresses):
    """Return a figure of stresses from `app.api.subsurface.survey`."""
    heading = f"{figures.make_title(result)}, {stresses.body}"
    return stress_figure(result.grid, stresses, heading)


def write(path, result, stresses, planes):
    """Write stresses in sections and on planes to an HDF5 file.

    `stresses` is the result of `app.api.subsurface.survey`: sections, a line, and the maxima. `planes` maps depths [mm]
    to the stresses on horizontal planes.
    """
    with atomic_hdf5(path) as file:
        at = stresses.at
        create_axes(file, {"x": result.x, "y": result.y, "depth": stresses.depths})
        file.attrs.update(poisson_ratio=stresses.poisson_ratio, x=at.x, y=at.y)
        for attribute, name, maximum in _maxima(stresses):
            file.attrs[attribute] = getattr(maximum, name)
            file.attrs.update({f"{attribute}_{axis}": getattr(maximum, axis) for axis in ("x", "y", "depth")})
        if stresses.interface is not None:
            file.attrs["interface"] = stresses.interface
        groups = {
            "section_x": (stresses.section_x, ("depth", "x")),
            "section_y": (stresses.section_y, ("depth", "y")),
            "line": (stresses.line, ("depth",)),
        }
        for number, (depth, plane) in enumerate(planes.items()):
            groups[f"plane_{number}"] = plane, ("y", "x")
            file.create_group(f"plane_{number}").attrs["depth"] = depth
        for group, (values, axes) in groups.items():
            fields = {f"sigma_{name}": part for name, part in zip(COMPONENTS, values, strict=True)}
            fields |= {"von_mises": von_mises(values), "max_shear": max_shear(values)}
            for name, field in fields.items():
                create_field(file, f"{group}/{name}", axes, "N/mm2", data=field)


def _maxima(stresses):
    """Return attribute, kind and position of each largest stress in `stresses`."""
    maxima = [
        ("max_von_mises", "von_mises", stresses.hottest),
        ("max_shear", "max_shear", stresses.sheared),
    ]
    if stresses.layers is not None:
        parts = stresses.layers._asdict()
        maxima.append(("max_interface_shear", "horizontal_shear", parts.pop("shear")))
        maxima += [(f"max_von_mises_{part}", "von_mises", at) for part, at in parts.items() if at is not None]
    return maxima


def add_body(add):
    """Add --poisson and --body to a parser by its method ``add_argument``."""
    add(
        "--poisson",
        type=argument_type(half),
        metavar="NU",
        help="Poisson's ratio of the body, 0 to 0.5; default: that of the result",
    )
    add(
        "--body",
        type=argument_type(_body),
        metavar="K",
        help="body in which to compute the stress: 1 or 2 (needs the materials of both)",
    )


def _arguments(argv):
    parser = Parser(
        prog="python -m app.subsurface", description="Compute the stress below the contact of a result."
    )
    add, default = parser.add_argument, "default: 4 times that of the largest stress, or more"
    add("result", type=Path, metavar="RESULT.h5", help="result file of app.solve")
    add("-o", "--output", type=Path, metavar="DIR", help="folder for subsurface.h5 and the picture")
    add_body(add)
    point = "point on the sections [mm]; default: that of the largest stress"
    add("--at", type=argument_type(_point), metavar="X,Y", help=point)
    add("--depths", type=count, default=64, metavar="N", help="number of depths; default: 64")
    add("--deepest", type=argument_type(_depth), metavar="Z", help=f"last depth [mm]; {default}")
    planes = "depths of horizontal planes [mm]"
    add("--planes", type=argument_type(_depths), default=(), metavar="Z1,Z2", help=planes)
    add_picture_options(add)
    arguments = parser.parse_args(argv)
    if arguments.output is not None:
        check_folder(arguments.output)
    else:
        names = ("at", "depths", "deepest", "planes", "title", "style", "format")
        unused = [f"--{name}" for name in names if getattr(arguments, name) != parser.get_default(name)]
        if unused:
            raise InputError(f"{', '.join(unused)}: no effect without -o DIR")
    return arguments


def summary(hottest, sheared, result, below):
    """Return lines of text with the largest stresses below the surface.

    Each text has a stress and its position. `hottest` and `sheared` are from `SubsurfaceStress.maxima`, the largest von
    Mises and the largest shear stress. Of a coated body, there are texts on the coating, the substrate and the
    interface, too.
    """
    highest = float(np.nanmax(result.pressure))
    # Without pressure, or below a uniform one, the stress has no maximum.
    variation = np.ptp(result.pressure)
    uniform = highest <= 0 or (result.grid.doubly_periodic and variation <= MIN_STRESS_VARIATION * highest)
    texts = []
    for name, value, at, body in _stated_stresses(hottest, sheared, result, below):
        unit = choose_length_unit(at.depth or float(np.ptp(result.x)))
        share = f", {value / highest:.3g} of the maximum pressure" if highest > 0 else ""
        place = f"at x = {at.x:.4g} mm, y = {at.y:.4g} mm, depth {at.depth * unit.per_mm:.4g} {unit.name}"
        texts.append(f"largest {name} {value:.6g} N/mm2{share}{body}\n  {'everywhere' if uniform else place}")
    return texts


def _stated_stresses(hottest, sheared, result, below):
    """Return name, value, position and material of each largest stress in `summary`."""
    layers = below.layer_maxima()
    if layers is None:
        ratios = np.atleast_1d(result.attributes.get("poisson", ()))
        numbers = [k for k, nu in enumerate(ratios, 1) if nu == below.nu] if len(set(ratios)) == 2 else []
        body = f", for nu = {below.nu:g}" + "".join(f" (body {k})" for k in numbers)
        return [
            ("von Mises stress", hottest.von_mises, hottest, body),
            ("shear stress", sheared.max_shear, sheared, body),
        ]
    coating, substrate = ", in the coating", ", in the substrate"
    stated = [
        ("von Mises stress", layers.coating, coating),
        ("von Mises stress", layers.substrate, substrate),
        ("von Mises stress at the interface", layers.coating_interface, coating),
        ("von Mises stress at the interface", layers.substrate_interface, substrate),
    ]
    return [
        *((name, at.von_mises, at, body) for name, at, body in stated if at is not None),
        ("shear stress on the interface", layers.shear.horizontal_shear, layers.shear, ""),
        (
            "shear stress",
            sheared.max_shear,
            sheared,
            coating if sheared.depth <= below.interface else substrate,
        ),
    ]


@command
def main(argv):
    """Run the command and return its exit status."""
    arguments = _arguments(argv)
    result = read_result(arguments.result)
    below = stress(result, arguments.poisson, arguments.body)
    if arguments.output is None:
        streams.print_output("\n".join(summary(*below.maxima(), result, below)))
        return 0
    names = [arguments.output / f"subsurface.{kind}" for kind in ("h5", *picture_kinds(arguments))]
    if arguments.output.exists():
        for name in names:
            check_output_path(name, [arguments.result], "-o", (name.suffix,))
    stresses = survey(below, arguments.depths, arguments.at, arguments.deepest)
    planes = {depth: below.plane(depth) for depth in arguments.planes}
    with report_write_errors(f"-o {arguments.output}"), style.use_style(arguments.style):
        arguments.output.mkdir(exist_ok=True)
        write(names[0], result, stresses, planes)
        figure = draw(result, stresses)
        if arguments.title:
            style.set_title(figure, arguments.title)
        for name in names[1:]:
            style.save_figure(figure, name)
    texts = summary(stresses.hottest, stresses.sheared, result, below)
    streams.print_output("\n".join([*texts, *map(str, names)]))
    return 0
