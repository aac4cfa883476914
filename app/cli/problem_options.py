"""Options of problem, loading and output; app.solve's request."""

import re
from contextlib import contextmanager
from functools import partial

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.base.quantities import ESTIMATED
from app.cli import load_path
from app.cli.geometry_options import ALTERNATIVES, FILES, GEOMETRY_OPTIONS, MATERIAL_OPTIONS
from app.contact.loading_input import LOADINGS
from app.contact.tilting_input import TILTING
from app.options.method import DEFAULT, METHOD_OPTIONS, PART_OPTIONS, PERIODIC
from app.options.option_table import FILES as OPTION_FILES
from app.options.option_table import (
    Option,
    OptionReader,
    count,
    describe_unknown_options,
    find_similar_name,
    flag,
    from_zero,
    lengths,
    list_named_files,
    pair_of_reals,
    real,
    subset,
    word,
)

_UNIT = re.compile(r"\[([^\]:]+)\]")  # in the meaning of an option
# Names that only PETSc can check.
_SOLVER_OPTION = re.compile("(^|_)(lcp|ksp|pc|mg|sub|snes|mat|vec)_")

share = real("above 0 and below 1", above=0, highest=1 - 1e-9)

_ERRORS = (*ESTIMATED, "area")


def _pair(unit):
    """Return the kind of a pair of numbers; lengths may have units."""
    kind = pair_of_reals(f"two numbers, for x and y [{unit}]")
    return lengths(kind) if unit == "mm" else kind


PROBLEM_OPTIONS = [
    *GEOMETRY_OPTIONS,
    *MATERIAL_OPTIONS,
    *(
        Option(name, lengths(real()) if loading.unit == "mm" else real(), None, f"{loading.meaning} [{loading.unit}]")
        for name, loading in LOADINGS.items()
    ),
    *(
        Option(name, _pair(unit), None, f"{meaning} [{unit}]") for name, (unit, meaning) in TILTING.items()
    ),
    Option("line_load", from_zero, None, "load per length of a roller, cylinder, or patch periodic in x or y [N/mm]"),
    *load_path.OPTIONS,
    Option("stiffness", flag, False, "compute dF/d(approach) and conductance, by one more linear solve"),
    Option("flow", flag, False, "solve for the flow of a fluid through the gap; -flow_ksp_*, -flow_pc_*: its solver"),
    Option("refine_until", share, None, "double the cells in x and y until estimated errors are below this"),
    Option("refine_for", subset(*_ERRORS), ESTIMATED, "refine_until: quantities whose errors must be small"),
    Option("refine_max", count, 4096**2, "refine_until: largest number of cells"),
    Option("output", word, None, "result file (HDF5)"),
    Option("title", word, None, "output: heading of pictures and report"),
]  # fmt: skip
UNITS = {
    option.name: unit[1].replace("2", "²").replace("3", "³")
    for option in PROBLEM_OPTIONS
    if (unit := _UNIT.search(option.meaning))
}
_PRESCRIBED = {name: loading.unit for name, loading in LOADINGS.items()} | {"line_load": "N/mm"}
LOADING = (*_PRESCRIBED, *(f"{name}_path" for name in LOADINGS))


class ProblemRequest:
    """Problem, method and output of a command, checked before any work. Collective.

    Attributes
    ----------
    problem : app.problems.problem.Problem
    flow : bool
    method : dict of str to dict
        Option file -> its options for the solver, which checks them.
    options : dict of str to str
        Options of the command line for the solver.
    texts : dict of str to str
        Options of problem, loading and output.
    output : str or None
    """

    table = PROBLEM_OPTIONS
    loadings = _PRESCRIBED  # name -> unit of those that the command names if none is given
    files = {}  # noqa: RUF012  arguments of `check_output_path`, if not for a result file

    def __init__(self, parsed, comm):
        from app.cli.geometry import make_problem  # -help does without MPI
        from app.flow.gap_flow import PREFIX, set_options
        from app.io.files import check_output_path, check_shared_folder, hash_samples

        texts, inputs = parsed.texts, list_input_files(parsed.texts)
        options, check_path = (
            resolve_alternatives(parsed, self.table),
            partial(check_output_path, **self.files),
        )
        self.output = call_collectively(comm, options.__getitem__, "output")
        if self.output:
            call_collectively(comm, check_path, self.output, [*parsed.files, *inputs])
            check_shared_folder(comm, self.output)
        call_collectively(comm, options.__getitem__, "problem")
        kind, value = read_loading(parsed, options, self.loadings)  # the default patch depends on it
        self.problem, own = call_collectively(comm, make_problem, options, texts, comm)
        for name in sorted(own.asked & texts.keys()):
            inputs += list_named_files(texts[name])
        if self.output:
            call_collectively(comm, check_path, self.output, inputs)
        for file in inputs:
            check_equal_on_ranks(comm, call_collectively(comm, hash_samples, file), f"input {file}")
        self.read_task(kind, value, options, parsed, inputs, comm)
        self.flow = options["flow"]
        flow_options = {name for name in texts if name.startswith(PREFIX)}
        if not self.flow and (names := flow_options & parsed.explicit_names()):
            raise InputError(f"-{min(names)}: needs -flow")
        call_collectively(comm, set_options, {name: texts[name] for name in flow_options})
        if names := set(options.unused()) - own.asked:
            unused = [option for option in self.table if option.name in names]
            one = f"has no effect here; it is: {unused[0].meaning}"
            effect = one if len(unused) == 1 else "have no effect here"
            raise InputError(f"{', '.join(sorted(f'-{option.name}' for option in unused))}: {effect}")
        problem_names = {option.name for option in self.table} | own.asked | flow_options
        self.method, self.options = parsed.split_by_source(texts.keys() - problem_names)
        known, unknown = _split_unknown(parsed.explicit_names(), self.table, own.names)
        if misspelt := [name for name in unknown if find_similar_name(name, known)]:
            raise InputError(describe_unknown_options(misspelt, known))
        self.texts = {name: texts[name] for name in texts.keys() & problem_names}

    def read_task(self, kind, value, options, parsed, inputs, comm):
        """Read what to compute, with the loading `kind`, from the reader `options`. Collective."""
        raise NotImplementedError


class Request(ProblemRequest):
    """Task of app.solve.

    Attributes
    ----------
    loading : dict
        Prescribed quantity -> value, as for `app.api.solver.ContactSolver.solve`; empty for a load path.
    tilting : dict
        Load centre, moment or tilt, as in `loading`.
    path : app.cli.load_path.PathRequest or None
    refine_until, refine_max : number or None
    quantities : tuple of str
        Numbers whose errors must be below `refine_until`.
    stiffness : bool
    title : str or None
    """

    def read_task(self, kind, value, options, parsed, inputs, comm):
        """Read loading, load path and refinement. Collective."""
        self.tilting = {name: options[name] for name in TILTING if options.given(name)}
        self.loading = {kind: value} | self.tilting
        self.path, self.refine_until = None, options["refine_until"]
        history = call_collectively(comm, load_path.read_history, options)
        if kind.endswith("_path") or history:
            arguments = kind.removesuffix("_path"), value, history, options, parsed, inputs, self.tilting
            self.loading, self.path = {}, call_collectively(comm, load_path.PathRequest, *arguments)
            if self.refine_until:
                raise InputError("-refine_until: needs a single loading, no path")
        self.refine_max, self.quantities = None, ()
        if self.refine_until:
            names = {"area": "contact_area"}
            self.quantities = tuple(names.get(name, name) for name in options["refine_for"])
            self.refine_max = options["refine_max"]
        self.title = options["title"] if self.output else None
        self.stiffness = options["stiffness"]


@contextmanager
def suggest_names(parsed, table=PROBLEM_OPTIONS):
    """Add suggestions for misspelt options to an InputError in a ``with`` block."""
    try:
        yield
    except InputError as error:
        known, unknown = _split_unknown(parsed.explicit_names(), table)
        if parsed.texts.get("problem") == "python":  # it may have options of its own
            unknown = [name for name in unknown if find_similar_name(name, known)]
        unknown = [name for name in unknown if f"-{name}" not in str(error)]
        if not unknown:
            raise
        raise InputError(f"{describe_unknown_options(unknown, known)}; {error}") from None


def _split_unknown(names, table, own=()):
    """Return the known option names, and the unknown names in `names`.

    `own` are further known names. Names that only PETSc can check do not count as unknown.
    """
    known = [*(option.name for option in (*table, *METHOD_OPTIONS)), *own]
    others = names - set(known)
    return known, [name for name in others if name.startswith("lcp_") or not _SOLVER_OPTION.search(name)]


def resolve_alternatives(parsed, table=PROBLEM_OPTIONS):
    """Remove overridden exclusive options; return a reader of the remaining options.

    Raises InputError if one source sets several options that exclude each other.
    """
    for alternatives in (LOADING, TILTING, *ALTERNATIVES):
        parsed.select_alternative(alternatives)
    return OptionReader(table, parsed.texts)


def read_loading(parsed, options, loadings=_PRESCRIBED):
    """Return the prescribed quantity and its value, or a path's values.

    `options` is the reader from `resolve_alternatives`, `loadings` maps names for messages to units. Raises InputError
    if the loading is missing or not allowed.
    """
    *others, last = (f"-{name} [{unit}]" for name, unit in loadings.items())
    kind = parsed.select_alternative(LOADING, f"{', '.join(others)} nor {last}")
    if kind == "line_load":
        from app.cli.geometry import find_load  # -help does without MPI

        return "load", find_load(options)
    return kind, options[kind]


def list_input_files(texts):
    """Return the names of files that define the problem."""
    return [file for name in FILES if name in texts for file in list_named_files(texts[name])]


def format_help():
    """Return the text of ``-help``, without PETSc."""
    names = [f"{name}.opts" for name in (DEFAULT, PERIODIC)]
    texts = {name: (OPTION_FILES / name).read_text(encoding="utf-8") for name in names}
    files = {name: dict(re.findall(r"^-(\w+) (\S+)", text, re.MULTILINE)) for name, text in texts.items()}
    lines = [
        "usage: python -m app.solve -options_file petsc_options/hertz.opts [-options_file METHOD.opts] [-grid 512] ...",
        "       mpiexec -n 2 python -m app.solve ...",
        "Lengths mm, forces N, stresses N/mm2; the same option said later, also in a file, overrides an earlier one.",
        "The problem, what is prescribed, the output:",
        *(option.help() for option in PROBLEM_OPTIONS),
        f"The method; an ordinary run takes {DEFAULT}.opts, on periodic patches {PERIODIC}.opts:",
        *(option.help(files) for option in METHOD_OPTIONS),
        "Of preconditioners (-pc_type python -pc_python_type ...):",
        *(option.help(files) for option in PART_OPTIONS),
        "Linear solvers: PETSc's own -ksp_*, -pc_*, -mg_levels_*, -mg_coarse_*; see petsc_options/, docs/options.md.",
        "With a problem, -help also lists PETSc's options of the solvers that it uses.",
    ]
    return "\n".join(lines)
