"""Options of the command that are not the solver's: the problem, what is prescribed, the output."""

from __future__ import annotations

import re
from contextlib import contextmanager

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.cli import load_path
from app.cli.geometry import ALTERNATIVES, FILES, GEOMETRY_OPTIONS, MATERIAL_OPTIONS, make_problem
from app.options.method import DEFAULT, METHOD_OPTIONS, PART_OPTIONS, PERIODIC, read_method_file
from app.options.option_table import (
    Option,
    OptionReader,
    count,
    describe_unknown_options,
    find_similar_name,
    flag,
    list_named_files,
    real,
    word,
)

# Who know better which options there are.
_OF_SOLVERS = re.compile("(^|_)(lcp|ksp|pc|mg|sub|tao|snes|mat|vec)_")

share = real("above 0 and below 1", above=0, highest=1 - 1e-9)

PROBLEM_OPTIONS = [
    *GEOMETRY_OPTIONS,
    *MATERIAL_OPTIONS,
    Option("approach", real(), None, "approach of the bodies [mm]; exactly one of this and the next seven"),
    Option("load", real(), None, "total normal force [N]"),
    Option("mean_pressure", real(), None, "load over the area of the patch, holes and all [N/mm2]"),
    Option("mean_gap", real(), None, "mean gap of a periodic patch without holes [mm]"),
    *load_path.OPTIONS,
    Option("stiffness", flag, False, "dF/d(approach), exactly, by one more linear solve"),
    Option("refine_until", share, None, "double the cells both ways until the errors they make are below"),
    Option("refine_max", count, 4096**2, "refine_until: most cells"),
    Option("output", word, None, "result file (HDF5)"),
]  # fmt: skip
LOADING = ("approach", "load", "mean_pressure", "mean_gap", *(f"{kind}_path" for kind in load_path.KINDS))


class Request:
    """All that a command is asked to do, checked before any work.

    Collective.

    Parameters
    ----------
    given : app.cli.option_sources.ParsedOptions
    comm : mpi4py.MPI.Comm

    Attributes
    ----------
    problem : app.problems.problem.Problem
    loading : dict
        Argument of `app.api.solver.ContactSolver.solve`; empty for a path.
    path : app.cli.load_path.PathRequest or None
    refine_until : float or None
    refine_max : int or None
    stiffness : bool
    method : dict of str to dict
        What option files say that is left for the solver, which knows which options there are.
    options : dict of str to str
        The same of the command line and the environment.
    texts : dict of str to str
        The other options.
    output : str or None

    Raises
    ------
    InputError
        On all ranks.
    """

    def __init__(self, given, comm):
        from app.io.files import check_output_path, check_shared_folder, hash_samples

        options, inputs = resolve_alternatives(given), list_input_files(given.texts)
        self.output = call_collectively(comm, options.__getitem__, "output")
        if self.output:
            call_collectively(comm, check_output_path, self.output, [*given.files, *inputs])
            check_shared_folder(comm, self.output)
        call_collectively(comm, options.__getitem__, "problem")
        kind, number = read_loading(given, options)  # before the patch that may follow from it
        self.problem, own = call_collectively(comm, make_problem, options, given.texts, comm)
        inputs += [
            file
            for name in sorted(own.asked & given.texts.keys())
            for file in list_named_files(given.texts[name])
        ]
        if self.output:
            # With those of the problem's own options.
            call_collectively(comm, check_output_path, self.output, inputs)
        for file in inputs:
            check_equal_on_ranks(comm, call_collectively(comm, hash_samples, file), f"input {file}")
        self.loading, self.path, self.refine_until = {kind: number}, None, options["refine_until"]
        if kind.endswith("_path"):
            self.loading = {}
            words = kind.removesuffix("_path"), options, given, inputs
            self.path = call_collectively(comm, load_path.PathRequest.of, *words)
            if self.refine_until:
                raise InputError(f"-refine_until: of one loading only, not of -{kind}")
        self.refine_max = options["refine_max"] if self.refine_until else None
        self.stiffness = options["stiffness"]
        if left := set(options.unused()) - own.asked:
            idle = [option for option in PROBLEM_OPTIONS if option.name in left]
            what = (
                f"has no effect here; it is: {idle[0].meaning}" if len(idle) == 1 else "have no effect here"
            )
            raise InputError(f"{', '.join(sorted(f'-{option.name}' for option in idle))}: {what}")
        taken = {option.name for option in PROBLEM_OPTIONS} | own.asked
        self.method, self.options = given.split_by_source(given.texts.keys() - taken)
        _refuse_method(self.options)
        known, unknown = _unknown(given.explicit_names(), own.names)
        if meant := [name for name in unknown if find_similar_name(name, known)]:
            raise InputError(describe_unknown_options(meant, known))
        self.texts = {name: given.texts[name] for name in given.texts.keys() & taken}


def _refuse_method(texts):
    """Tell how a method is chosen."""
    if "method" in texts:
        name = texts["method"] or "NAME"
        raise InputError(
            f"-method {name}: a method is an option file; needed: -options_file {name.removesuffix('.opts')}.opts"
        )


@contextmanager
def suggest_names(given):
    """Whatever is refused meanwhile, name options that nobody knows but that are nearly called like others.

    Not collective. What they were meant to say is missing then, and would be complained of alone.
    """
    try:
        yield
    except InputError as error:
        known, unknown = _unknown(given.explicit_names())
        own = given.texts.get("problem") == "python"  # which may have any
        meant = [
            name
            for name in unknown
            if (find_similar_name(name, known) or not own) and f"-{name}" not in str(error)
        ]
        if not meant:
            raise
        raise InputError(f"{describe_unknown_options(meant, known)}; {error}") from None


def _unknown(names, own=()):
    """Names of the options of the tables and a problem's `own`, and others that do not look like a solver's."""
    known = [*(option.name for option in (*PROBLEM_OPTIONS, *METHOD_OPTIONS)), *own]
    others = names - set(known)
    return known, [name for name in others if name.startswith("lcp_") or not _OF_SOLVERS.search(name)]


def resolve_alternatives(given):
    """Of options that exclude each other keep the ones of the last place that gives any. Not collective.

    Returns
    -------
    OptionReader
        Of the problem's options that are left.

    Raises
    ------
    InputError
        If more than one are given there.
    """
    for alternatives in (LOADING, *ALTERNATIVES):
        given.select_alternative(alternatives)
    return OptionReader(PROBLEM_OPTIONS, given.texts)


def read_loading(given, options):
    """What is prescribed: ``("approach", mm)``, ``("load", N)``, ...; of a path all numbers. Not collective.

    Parameters
    ----------
    given : app.cli.option_sources.ParsedOptions
    options : OptionReader
        What `settle` has returned.

    Raises
    ------
    InputError
        If none is given, or is not allowed.
    """
    kind = given.select_alternative(
        LOADING, "-approach [mm], -load [N], -mean_pressure [N/mm2] nor -mean_gap [mm]"
    )
    return kind, options[kind]


def list_input_files(texts):
    """Names of the files that the problem is read from; a result must not take their place. Not collective."""
    return [file for name in FILES if name in texts for file in list_named_files(texts[name])]


def format_help():
    """All options of the command, for ``-help``. Not collective."""
    files = {f"{name}.opts": read_method_file(name) for name in (DEFAULT, PERIODIC)}
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
