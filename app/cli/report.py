"""Describe a result in one web page: ``python -m app.report RESULT.h5 [-o report.html]``.

The page needs no other file and no network. Exit status 0, or 2 after an error. Runs on one rank.
"""

import base64
import io
import re
from dataclasses import dataclass, field
from functools import partial
from numbers import Real
from pathlib import Path

import jinja2
import numpy as np

from app.api.contact_shape import EXTENTS, SEMI_AXES, contact_shape
from app.api.subsurface import find_layer, find_poisson_ratio, stress, survey
from app.api.summary import NOT_CONVERGING, centre_of_pressure, fails_to_converge
from app.base.errors import InputError, is_number
from app.base.quantities import ESTIMATED, REPORTED, label_of, unit_of
from app.base.units import choose_length_unit, format_quantity
from app.cli import streams, subsurface
from app.cli.arguments import Parser, command
from app.cli.problem_options import UNITS
from app.io.files import check_output_path, report_write_errors, write_text
from app.io.result import read_result
from app.plots import figures, style
from app.plots.pictures import PICTURES, analytic_reference, pictures_of

_ORIGIN = {
    "version": "version",
    "ranks": "MPI ranks",
    "setup_seconds": "set-up [s]",
    "solve_seconds": "solve [s]",
    "active_set_iterations": "active set iterations",
    "inner_iterations": "inner iterations",
    "operator_applications": "operator applications",
    "residual": "residual, (5.1)",
}
_REQUESTED = (
    "hertz_", "sphere_", "cylinder_", "roller_", "cone_", "punch_", "surface_", "body",
    "young", "poisson", "coating_", "shear_", "gap_", "resistivity", "thermal_conductivity",
    "background_pressure", "relax", "friction",
)  # fmt: skip
_UNITS = UNITS | {"relaxation_times": "s"}
_IN_SUMMARY = ("contact", "pressure", "history")  # figures
_PATH_COLUMNS = (  # as many as the page is wide; the result file has all
    "time", "sliding_distance", "load", "approach", "mean_pressure", "max_pressure", "contact_area",
    "contact_fraction", "mean_gap", "worn_volume", "stiffness", "stiffness_by_differences",
)  # fmt: skip
_MAX_ROWS = 200
_DPI, _SHOWN = 100, 0.68  # of pictures; pixels on the page over those of a picture


@dataclass
class Section:
    """Section of the page: heading, texts, tables, pictures."""

    name: str
    heading: str
    texts: list = field(default_factory=list)
    quantities: list = field(default_factory=list)
    facts: dict = field(default_factory=dict)
    rows: list = field(default_factory=list)
    pictures: dict = field(default_factory=dict)


_format = partial(format_quantity, digits=6)


def typeset(text):
    """Return text with long minus signs, µm and superscripts."""
    text = re.sub(r"(?<=\d\s)u(?=[mN])", "µ", text)
    text = re.sub(r"((?:^|\s|\[|N/)[nµm]?m)([23])\b", lambda unit: unit[1] + "²³"[unit[2] == "3"], text)
    return re.sub(r"(?<![^\s(])-(?=\d)|(?<=\de)-(?=\d)", "−", text)


def format_attribute(value):
    """Return an attribute as text; numbers have six digits."""
    if isinstance(value, str):
        return value
    return ", ".join(f"{part:.6g}" if isinstance(part, Real) else str(part) for part in np.ravel(value))


def _is_number(value):
    return is_number(value) and np.isfinite(value)


def numbers_section(result):
    """Return the section of result numbers and their meanings."""
    grid = result.grid
    values = result.attributes | result.count_patches()
    values |= dict.fromkeys((*SEMI_AXES, *EXTENTS)) | contact_shape(values, grid)
    values |= {f"pressure_centre_{name}": at for name, at in centre_of_pressure(values, grid).items()}
    values |= {name: values.get(name) or None for name in ("tilt_x", "tilt_y")}
    quantities = []
    for name, (unit, _, meaning, _) in REPORTED.items():
        value, exact = values.get(name), values.get(f"analytic_{name}")
        if _is_number(value):
            # A prescribed quantity does not differ from its analytic value.
            differs = _is_number(exact) and exact and abs(value / exact - 1) > 1e-12
            unbroken = _format(exact, unit).replace(" ", "\N{NO-BREAK SPACE}") if differs else ""
            analytic = f"analytic {unbroken} ({100 * (value / exact - 1):+.2g}%)" if differs else ""
            remarks = [analytic, NOT_CONVERGING if fails_to_converge(values, name) else ""]
            quantities.append((label_of(name), _format(value, unit), list(filter(None, remarks)), meaning))
    modulus, slope = (values.get(name, np.nan) for name in ("contact_modulus", "rms_slope"))
    for name, scale, label, meaning in (
        ("max_pressure", modulus, "maximum pressure over E*",
         "far below 1 where bodies stay elastic and slopes small"),
        ("mean_pressure", modulus * slope if "persson_fraction" in values else 0.0,
         "mean pressure over E* times rms slope", "what the contact fraction follows"),
    ):  # fmt: skip
        if _is_number(values.get(name)) and scale > 0:
            quantities.append((label, f"{values[name] / scale:.3g}", [], meaning))
    names, steps = ("label", "value", "remarks", "meaning"), len(result.path.get("load", ()))
    heading = "Result"
    if steps > 1:
        heading = f"Last of {steps} steps, load {_format(values['load'], 'N')}"
    return Section("result", heading, quantities=[dict(zip(names, row, strict=True)) for row in quantities])


def proof_section(values):
    """Return the section on the proved error bound and estimated grid errors."""
    bound, texts = values.get("error_bound", np.nan), []
    if np.isfinite(bound):
        texts.append(
            f"Proved: the pressure differs from the exact one on this grid by at most {_percent(bound)}, in the energy "
            "norm. The bound follows from the pressure alone, whatever method found it."
        )
        overlap, lowest = values.get("largest_penetration", 0.0), values.get("smallest_pressure", 0.0)
        sign = f"The lowest pressure is {format_quantity(lowest, 'N/mm2', 2)}."
        sign = sign if lowest < 0 else "No pressure is negative."
        texts.append(f"The bodies overlap by at most {format_quantity(overlap, 'mm', 2)}. {sign}")
    else:
        texts.append(
            "Nothing is proved about the pressure: there is no certificate, or it does not bound the error."
        )
    errors = {label_of(name): values.get(f"{name}_error", np.nan) for name in ESTIMATED}
    errors["pressure (root mean square)"] = values.get("discretisation_error", np.nan)
    known = [f"{label} {_percent(error)}" for label, error in errors.items() if 0 < error < 1]
    if known:
        texts.append(f"Estimated error of the grid: {', '.join(known)}.")
    elif not any(error >= 1 for error in errors.values()):
        texts.append(
            "The error of the grid is not known from this run: solve on a grid twice as fine, and compare."
        )
    for label, error in errors.items():
        if error >= 1:
            texts.append(
                f"The {label} {NOT_CONVERGING}: finer grids change it, as they change the pressure at a sharp edge."
            )
    return Section("accuracy", "How good it is", texts)


def _percent(share):
    return f"{100 * share:.2g}%"


def request_section(result):
    """Return the section on the problem and its options."""
    values = result.attributes
    ny, nx = result.pressure.shape
    grid = result.grid
    unit = choose_length_unit(max(grid.sides))
    size = " × ".join(f"{side * unit.per_mm:.6g}" for side in grid.sides)
    cell = choose_length_unit(max(grid.dx, grid.dy))
    kind = "periodic" if grid.periodic else "free"
    kind += f" in {grid.one_way}" if grid.one_way else ""
    facts = {
        "problem": figures.PROBLEMS.get(values.get("problem"), values.get("problem", "")),
        "patch": f"{size} {unit.name}, {kind}",
        "cells": f"{nx} × {ny}, each {grid.dx * cell.per_mm:.4g} × {grid.dy * cell.per_mm:.4g} {cell.name}",
    }
    arrays = dict.fromkeys(
        result.extra.keys() & {"background_pressure", "surface_compliance"}, "of each cell"
    )
    for name, value in (values | arrays).items():
        if name.startswith(_REQUESTED):
            unit = "" if isinstance(value, str) else _UNITS.get(name, "")
            facts[name] = f"{format_attribute(value)} {unit}".rstrip()
    if values.get("command_line"):
        facts["command line"] = values["command_line"]
    return Section("asked", "What was asked", facts=facts)


def path_section(result, pictures):
    """Return the section with a load path's table."""
    columns, rows = {}, []
    for name in ("step", *_PATH_COLUMNS):
        column = np.asarray(result.path.get(name, np.nan))
        if column.dtype.kind in "biuf" and not np.isnan(column).all():
            unit = unit_of(name)
            columns[label_of(name) if unit == "1" else f"{label_of(name)} [{unit}]"] = column
    steps = len(next(iter(result.path.values())))
    for k in range(min(steps, _MAX_ROWS)):
        row = {heading: column[k] for heading, column in columns.items()}
        rows.append({heading: "" if np.isnan(value) else f"{value:z.6g}" for heading, value in row.items()})
    text = f"The first {_MAX_ROWS} of {steps} steps." if steps > _MAX_ROWS else f"{steps} steps."
    return Section("path", "Load path", ["1 step." if steps == 1 else text], rows=rows, pictures=pictures)


def stress_section(result, poisson_ratio=None, body=None):
    """Return the section on stresses below the surface.

    `poisson_ratio` and `body` are as in `app.api.subsurface.stress`.
    """
    facts = result.attributes
    unknown = find_poisson_ratio(facts, body) is None and find_layer(facts, body) is None
    if poisson_ratio is None and unknown:
        text = "Poisson's ratio is not known, so the stresses are not (--poisson gives it)."
        return Section("stress", "Below the surface", [text])
    if not np.isfinite(result.pressure).all():
        text = "Pressures of this run are not finite, so there are no stresses."
        return Section("stress", "Below the surface", [text])
    below = stress(result, poisson_ratio, body)
    stresses = survey(below)
    texts = subsurface.summary(stresses.hottest, stresses.sheared, result, below)
    texts = [text[0].upper() + " ".join(text[1:].split()) + "." for text in texts]
    pictures = {"stress": _encode(subsurface.draw(result, stresses))}
    return Section("stress", "Below the surface", texts, pictures=pictures)


def _encode(figure):
    """Return a figure as PNG, and its width on the page [pixels]."""
    image = io.BytesIO()
    style.write_figure(figure, image, "png", _DPI)
    return image.getvalue(), round(_SHOWN * _DPI * figure.get_figwidth())


def web_page(result, poisson_ratio=None, body=None, with_stress=True):
    """Return the HTML page of a result.

    `poisson_ratio` and `body` are as in `app.api.subsurface.stress`. Stresses take most of the time; without
    `with_stress` they are left out.
    """
    values = result.attributes
    stresses = [stress_section(result, poisson_ratio, body)] if with_stress else []
    names = [name for name in PICTURES if name not in (*_IN_SUMMARY, "summary")]
    pictures = {name: _encode(figure) for name, figure in pictures_of(result, names)}
    # The section on stresses has the largest stress, to all digits.
    summary = figures.summary_figure(result, analytic_reference(result), with_stress=not with_stress)
    path_picture = {name: pictures.pop(name) for name in ("path",) if name in pictures}
    sections = [numbers_section(result), proof_section(values)]
    sections[0].pictures = {"summary": _encode(summary)}
    if values.get("notes"):
        sections.insert(1, Section("notes", "To look at twice", values["notes"].splitlines()))
    if result.path:
        sections.append(path_section(result, path_picture))
    sections += stresses
    sections.append(Section("pictures", "Pictures", pictures=pictures))
    sections.append(request_section(result))
    origin = {label: format_attribute(values[name]) for name, label in _ORIGIN.items() if name in values}
    sections.append(Section("made", "How it was made", facts=origin))
    state = f"{'Solved' if values['converged'] else 'NOT SOLVED'}: {values['reason']}."
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("app.cli"), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters |= {"base64": lambda data: base64.b64encode(data).decode(), "typeset": typeset}
    return environment.get_template("result.html").render(
        title=figures.make_title(result, path=bool(result.path)),
        converged=values["converged"],
        state=state,
        sections=sections,
    )


@command
def main(argv):
    """Run the command and return its exit status."""
    parser = Parser(prog="python -m app.report", description="Write a result as one web page.")
    parser.add_argument("result", type=Path, metavar="RESULT.h5", help="result file of app.solve")
    parser.add_argument("-o", "--output", type=Path, metavar="F.html", help="default: RESULT.html")
    subsurface.add_body(parser.add_argument)
    parser.add_argument("--title", metavar="TEXT", help="heading; default: that of the result")
    parser.add_argument(
        "--no-stress", action="store_true", help="leave out the stress below the surface; saves time"
    )
    arguments = parser.parse_args(argv)
    if arguments.no_stress and (arguments.poisson is not None or arguments.body):
        raise InputError("--poisson, --body: have no effect with --no-stress")
    output = arguments.output or arguments.result.parent / f"{arguments.result.stem}.html"
    check_output_path(output, [arguments.result], "-o", (".html", ".htm"))
    result = read_result(arguments.result)
    if arguments.title:
        result.attributes["title"] = arguments.title
    text = web_page(result, arguments.poisson, arguments.body, not arguments.no_stress)
    with report_write_errors(f"-o {output}"):
        write_text(output, text)
    streams.print_output(str(output))
    return 0
