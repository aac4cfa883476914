"""Options of the command that are not the solver's: the problem, what is prescribed, the output."""

from __future__ import annotations

from app.commands import load_path
from app.commands.geometry import ALTERNATIVES, FILES, GEOMETRY_OPTIONS, MATERIAL_OPTIONS, make_problem
from app.errors import InputError, agree, check_alike
from app.options import Option, OptionReader, as_line, count, flag, real, word

__all__ = ["PROBLEM_OPTIONS", "Request", "help_text", "loading", "make_problem", "reader_of", "settle"]

share = real("above 0 and below 1", above=0, highest=1 - 1e-9)

PROBLEM_OPTIONS = [
    *GEOMETRY_OPTIONS,
    *MATERIAL_OPTIONS,
    Option("approach", real(), None, "approach of the bodies [mm] (this or one of the next three)"),
    Option("load", real(), None, "total normal force [N]"),
    Option("mean_pressure", real(), None, "load over the area of the patch [N/mm2]"),
    Option("mean_gap", real(), None, "mean gap of a periodic patch [mm]"),
    *load_path.OPTIONS,
    Option("stiffness", flag, False, "solve for the contact stiffness, too"),
    Option("refine_until", share, None, "finer and finer grids until the errors that cells make are below"),
    Option("refine_max", count, 4096**2, "refine_until: most cells"),
    Option("output", word, None, "result file (HDF5)"),
    Option("lcp_monitor", flag, False, "a line for each active set iteration"),
]  # fmt: skip
LOADING = ("approach", "load", "mean_pressure", "mean_gap", *(f"{kind}_path" for kind in load_path.KINDS))


class Request:
    """All that a command is asked to do, checked before any work.

    Collective.

    Parameters
    ----------
    given : app.commands.places.Given
    comm : mpi4py.MPI.Comm

    Attributes
    ----------
    problem : app.problems.problem.Problem
    loading : dict
        Argument of `app.solver.ContactSolver.solve`; empty for a path.
    path : app.commands.load_path.PathRequest or None
    refine_until : float or None
    refine_max : int
    stiffness : bool
    inputs : list of str
        Files that the problem is read from.
    method : dict of str to str
        Options left for the solver, which knows which of them there are.
    options_text : str
        The other options, as they would be written on a command line.
    output : str or None
    wants_monitor : bool

    Raises
    ------
    InputError
        On all ranks.
    """

    def __init__(self, given, comm):
        from app.output.files import check_output_path, fingerprint

        settle(given)
        options = reader_of(given)
        self.output = agree(comm, options.__getitem__, "output")
        if self.output:
            agree(comm, check_output_path, self.output, [*given.files, *input_files(given.texts)])
        self.problem, own = agree(comm, make_problem, options, given.texts, comm)
        self.inputs = input_files(given.texts)
        for file in self.inputs:
            check_alike(comm, agree(comm, fingerprint, file), f"input {file}")
        kind, number = loading(given)
        options.asked.add(kind)
        self.loading, self.path, self.refine_until = {kind: number}, None, options["refine_until"]
        if kind.endswith("_path"):
            self.loading = {}
            self.path = agree(
                comm, load_path.PathRequest.of, kind.removesuffix("_path"), options, self.output
            )
            if self.refine_until:
                raise InputError(f"-refine_until: of one loading only, not of -{kind}")
        self.refine_max = options["refine_max"] if self.refine_until else None
        self.stiffness = options["stiffness"]
        self.wants_monitor = options["lcp_monitor"]
        if left := set(options.unused()) - own.asked:
            raise InputError(unused(left))
        taken = {option.name for option in PROBLEM_OPTIONS} | own.asked
        self.method = {name: text for name, text in given.texts.items() if name not in taken}
        self.identity = load_path.identifying(given.texts)
        self.options_text = as_line({name: given.texts[name] for name in given.texts.keys() & taken})


def unused(names):
    """Complain about options that have no effect."""
    return f"unknown or unused option{'s'[: len(names) > 1]}: -{', -'.join(sorted(names))}"


def reader_of(given):
    """Reader of the problem's options. Not collective."""
    return OptionReader(PROBLEM_OPTIONS, given.texts)


def settle(given):
    """Of options that exclude each other keep the ones of the last place that gives any. Not collective.

    Raises
    ------
    InputError
        If more than one are given there.
    """
    for alternatives in (LOADING, *ALTERNATIVES):
        given.last_of(alternatives)


def loading(given):
    """What is prescribed: ``("approach", mm)``, ``("load", N)``, ...; one in a later place replaces the others.

    Not collective.

    Raises
    ------
    InputError
        If none is given, or several in the same place.
    """
    kind = given.last_of(LOADING, "-approach [mm], -load [N], -mean_pressure [N/mm2] nor -mean_gap [mm]")
    return kind, reader_of(given)[kind]


def input_files(texts):
    """Names of the files that the problem is read from; a result must not take their place. Not collective."""
    names = [texts[name] for name in FILES if name in texts]
    return [part for name in names for part in (name, name.rpartition(":")[0]) if part]


def help_text():
    """All options of the command, for ``-help``. Not collective."""
    from app.method import METHOD_OPTIONS

    circulant = "app.fast.circulant.Circulant"
    lines = ["Options of app.solve (lengths mm, forces N, stresses N/mm2):"]
    lines += [option.help() for option in (*PROBLEM_OPTIONS, *METHOD_OPTIONS)]
    lines += [
        f"Of the FFT preconditioner (-pc_type python -pc_python_type {circulant}):",
        f"  -{'pc_circulant_extend':<20} cells by which the residual is extended over the rim (default 0)",
        f"  -{'pc_circulant_margin':<20} share of the patch left free before it is continued periodically (default 0)",
        "Linear solvers: PETSc's own -ksp_*, -pc_*, -mg_levels_*, -mg_coarse_*; see petsc_options/ and README.md.",
    ]
    return "\n".join(lines)
