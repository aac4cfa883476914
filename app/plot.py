"""Draw the pictures of a result file: ``python -m app.plot RESULT.h5 -o DIR``.

Writes contact, pressure, deformation, sections, history and summary, and prints their paths. Exit status 0,
or 2 with one line on standard error if there is something wrong with the input. Runs on one rank.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from app.commands import streams
from app.errors import one_line
from app.output import figures
from app.output.result import read_result
from app.reference.hertz import EllipticHertz


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        raise ValueError(message)


def analytic_reference(result):
    """Return the exact pressure of the result's problem as `figures.Reference`, or None if there is none.

    Raises
    ------
    ValueError
        If the result says it is a Hertz contact but lacks one of its numbers.
    """
    values = result.attributes
    if (
        values.get("problem") != "hertz"
        or values["approach"] <= 0
        or values.get("periodic")
        or values.get("surfaces")
    ):
        return None
    if "contact_modulus" not in values and {"shear_modulus", "poisson_ratio"} <= values.keys():  # before 0.3
        values = values | {"contact_modulus": values["shear_modulus"] / (1 - values["poisson_ratio"])}
    needed = ("hertz_rx", "hertz_ry", "contact_modulus")
    missing = [name for name in needed if name not in values]
    if missing:
        raise ValueError(f"problem is hertz, but attribute {', '.join(missing)} is missing")
    exact = EllipticHertz.from_approach(*(values[name] for name in needed), values["approach"])
    return figures.Reference(exact.pressure, "Hertz")


def draw(result, folder, kind="png", dpi=200):
    """Write all pictures of a result to an existing folder and return their paths."""
    reference = analytic_reference(result)
    pictures = {
        "contact": figures.contact_figure(result),
        "pressure": figures.pressure_figure(result),
        "deformation": figures.deformation_figure(result),
        "sections": figures.section_figure(result, reference),
        "history": figures.history_figure(result),
        "summary": figures.summary_figure(result, reference),
    }
    paths = []
    for name, figure in pictures.items():
        paths.append(folder / f"{name}.{kind}")
        figures.save_figure(figure, paths[-1], dpi)
    return paths


def main(argv=None):
    """Run the command and return its exit status."""
    parser = _Parser(prog="python -m app.plot", description="Draw the pictures of a result file.")
    parser.add_argument("result", type=Path, metavar="RESULT.h5", help="result file of app.solve")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("--format", choices=("png", "pdf", "svg"), default="png", help="default: png")
    parser.add_argument("--dpi", type=int, default=200, help="pixels per inch, 20 to 1200; default: 200")
    try:
        arguments = parser.parse_args(argv)
        if not 20 <= arguments.dpi <= 1200:
            raise ValueError(f"--dpi {arguments.dpi}: must be from 20 to 1200")
        result = read_result(arguments.result)
        if arguments.output.exists() and not arguments.output.is_dir():
            raise ValueError(f"-o {arguments.output}: exists and is not a folder")
        if not arguments.output.parent.is_dir():
            raise ValueError(f"-o {arguments.output}: folder {arguments.output.parent} does not exist")
        arguments.output.mkdir(exist_ok=True)
        try:
            paths = draw(result, arguments.output, arguments.format, arguments.dpi)
        except OSError as error:
            raise ValueError(f"-o {arguments.output}: cannot be written to: {error.strerror}") from None
    except (ValueError, OSError, MemoryError) as error:
        streams.complain(f"error: {one_line(error)}")
        return 2
    streams.say("\n".join(map(str, paths)))
    return 0


if __name__ == "__main__":
    streams.repair()
    sys.exit(main())
