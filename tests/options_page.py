"""docs/options.md: every option of every command, from the tables and parsers that read them.

The page is written by

    python tests/options_page.py
"""

import importlib
from pathlib import Path

from app.cli import arguments, load_path
from app.cli.geometry_options import GEOMETRY_OPTIONS, MATERIAL_OPTIONS
from app.cli.law import ARGUMENTS
from app.cli.problem_options import LOADING, PROBLEM_OPTIONS
from app.contact.tilting_input import TILTING
from app.options.method import METHOD_OPTIONS, PART_OPTIONS, read_method_file
from app.options.option_table import format_value

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "options.md"
DEFAULT_METHODS = ("fast", "primal")
_OF_SHAPES = ("hertz_", "body", "sphere_", "cylinder_", "roller_", "cone_", "punch_")

_HEAD = """# Options

This page is written by `python tests/options_page.py` from the tables that the program itself reads; a test checks it.
Lengths are in mm, forces in N, stresses in N/mm2. `python -m app.solve -help` prints the same options. In Python,
`options={"lcp_rtol": 1e-8}` sets options of the [method](#method), of [parts](#parts) and of [linear
solvers](#linear-solvers); write their names without the dash.

Options come from `PETSC_OPTIONS`, from option files (`-options_file F`, one option per line), and from the command
line. Later options override earlier ones: see [the command line](command-line.md#what-overrides-what). Two options that
exclude each other are refused if they are in the same place. An option that has no effect together with the others is
refused, too. If the default of an option is empty, the option is off, or must be given if the problem needs it.
"""
_PROBLEM = """The page on surfaces describes the [base shapes](surfaces.md#base-shapes). Without `-domain`, the patch
follows from the analytic solution for the shape; `-domain auto` fits the patch to the contact. If a surface file
states its spacing, the patch is centred on the origin. `-periodic` makes a [periodic patch](periodic.md).
"""
_MATERIALS = """Give the materials by exactly one of these groups of options; the page on surfaces has the
[formulas](surfaces.md#materials)."""
_SHAPES = """These options are for `-problem hertz`, `sphere`, `cylinder`, `roller`, `cone` and `punch`; see
[base shapes](surfaces.md#base-shapes)."""
_ROUGH = """Any base shape can carry several rough surfaces: see [rough surfaces](surfaces.md#rough-surfaces). A punch
has the paper's waves unless another surface is given. Other shapes have these waves if `-surface_sigma`,
`-surface_decay` or `-surface_modes` is given. A self-affine surface is periodic on the patch, and its mean is zero.
Give exactly one of the rms slope and the rms height.
"""
_LOADING = """Give exactly one of `-approach`, `-load`, `-mean_pressure` and `-mean_gap`, or exactly one
load path of many numbers (`-approach_path` and so on; see [load curves](load-paths.md)). With a load, `-load_centre` or
`-moment` tilts the bodies; with a load or an approach, `-tilt` prescribes the [tilt](tilt.md)."""
_OUTPUT = "The page [results](results.md) describes the result file."
_METHOD = """The table has the default of each option, and the values that the default methods set: `fast.opts` on free
patches, `primal.opts` on periodic patches. The page [methods](methods.md) describes the methods. With `primal`,
`-lcp_coarse_rtol` limits the gap divided by the deviation of h from its mean, or by the approach beyond first touch if
that is smaller.
"""
_PARTS = """These options belong to preconditioners that a method file chooses by `-pc_python_type`:
`app.methods.free.circulant.Circulant` and `app.methods.periodic.two_grid.TwoGrid`.
"""
_LINEAR = """
## Linear solvers

`-ksp_*`, `-pc_*`, `-mg_levels_*` and `-mg_coarse_*` are PETSc's options of the linear solver, which is called once per
active set iteration. `-ksp_view`, `-ksp_monitor`, `-log_view` and `-options_file` are PETSc's options, too. The page
methods lists [useful options](methods.md#petscs-options).
"""
_COMMANDS = """
## Other commands

The page [commands](commands.md) describes the commands. Each command also has `--help` and `--version`.
"""
_LAW = """
### python -m app.law

Compute a [contact law](law.md), on any number of ranks. The options of problem, materials, surfaces and method are
those of `app.solve`, and so are `-load_path`, `-mean_pressure_path` and `-flow`. `-output`, or `-o`, is the file for
the table. Further options are:

"""


def sections():
    """Heading, text and options of each table of app.solve; every option is in one of them."""
    left = {option.name: option for option in PROBLEM_OPTIONS}

    def taken(chosen):
        return [left.pop(name) for name in list(left) if chosen(left[name])]

    path = (option.name for option in load_path.OPTIONS)
    loading = {*LOADING, *TILTING, *path, "refine_until", "refine_max", "stiffness"}
    materials = taken(lambda option: option in MATERIAL_OPTIONS)
    rough = taken(lambda option: option.name.startswith("surface_"))
    shapes = taken(lambda option: option.name.startswith(_OF_SHAPES))
    yield "Problem, patch and grid", _PROBLEM, taken(lambda option: option in GEOMETRY_OPTIONS)
    yield "Materials", _MATERIALS, materials
    yield "Base shapes", _SHAPES, shapes
    yield "Rough surfaces", _ROUGH, rough
    yield "What is prescribed", _LOADING, taken(lambda option: option.name in loading)
    yield "Output", _OUTPUT, list(left.values())


def allowed(option):
    """Words of the error that a wrong value brings; nothing for free text."""
    try:
        option.kind("?")
    except ValueError as error:
        return str(error)
    return ""


def table(head, rows):
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return (
        "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        + "\n"
    )


def code(text):
    """Text as code; nothing for nothing."""
    return f"`{text}`" if text else ""


def options_table(options, methods=()):
    """A row for each option, with what some method files set."""
    files = [read_method_file(name) for name in methods]
    head = ["option", "default", *(f"`{name}.opts`" for name in methods), "allowed", "meaning"]
    rows = []
    for option in options:
        there = (code(file.get(option.name, "")) for file in files)
        meaning = option.meaning.replace("||", "‖")
        rows.append(
            [f"`-{option.name}`", code(format_value(option.default)), *there, allowed(option), meaning]
        )
    return table(head, rows)


class _Found(BaseException):
    """The parser of a command."""


def parser_of(module):
    """Parser that the ``main`` of a command makes."""

    def found(parser, *_):
        raise _Found(parser)

    kept, arguments.Parser.parse_args = arguments.Parser.parse_args, found
    try:
        importlib.import_module(module).main([])
    except _Found as parser:
        return parser.args[0]
    finally:
        arguments.Parser.parse_args = kept
    raise LookupError(f"{module} has no parser")


def commands():
    """Modules of app/ that read words in the style of the shell."""
    entries = (path for path in (ROOT / "app").glob("*.py") if "import main\n" in path.read_text())
    return sorted(f"app.{path.stem}" for path in entries if path.stem != "solve")


def command_table(parser):
    """A row for each argument of a command."""
    rows = []
    for action in parser._actions[2:]:  # after --help and --version
        names = " ".join(f"`{name}`" for name in action.option_strings)
        value = action.metavar or (
            "|".join(map(str, action.choices)) if action.choices else action.dest.upper()
        )
        value = f"`{value}`" if action.nargs != 0 else ""
        rows.append([f"{names} {value}".strip(), (action.help or "").replace("%%", "%")])
    return table(["argument", "meaning"], rows)


def page():
    """Return the text of docs/options.md."""
    parts = [_HEAD]
    for heading, text, options in sections():
        parts.append(f"\n## {heading}\n\n{text.strip()}\n\n{options_table(options)}")
    parts.append(f"\n## Method\n\n{_METHOD.strip()}\n\n{options_table(METHOD_OPTIONS, DEFAULT_METHODS)}")
    parts.append(f"\n## Parts\n\n{_PARTS.strip()}\n\n{options_table(PART_OPTIONS, DEFAULT_METHODS)}")
    parts.append(_LINEAR)
    parts.append(_COMMANDS)
    for module in commands():
        if module == "app.law":
            parts.append(_LAW + options_table(ARGUMENTS))
            continue
        parser = parser_of(module)
        parts.append(f"\n### {parser.prog}\n\n{parser.description}\n\n{command_table(parser)}")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
