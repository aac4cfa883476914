"""Compute the law of a contact: ``mpiexec -n 2 python -m app.law -options_file F.opts -load_path 1,1000 -o law.csv``.

The law is a table of load, approach, stiffness and other numbers, so close that interpolation between its rows is
accurate; see `app.api.law`. Exit status: 0, 2 for bad input, or 3 if a solve has not converged, or the table has not
reached its tolerance; then the table is written, too.
"""

import os

from app.base.errors import InputError, NoteWarning, call_collectively
from app.base.mpi import launched_rank
from app.base.quantities import unit_of
from app.cli import session, streams
from app.cli.problem_options import PROBLEM_OPTIONS, ProblemRequest, suggest_names
from app.options.option_table import Option, flag, integer, positive, real, word

SUFFIXES = (".csv", ".h5", ".hdf5", ".mat", ".md", ".txt")
LOADINGS = {"load_path": "N", "mean_pressure_path": "N/mm2"}
ARGUMENTS = [  # of `ContactSolver.law`
    Option("tolerance", positive, 1e-3, "add loads until another one changes the interpolated load by no more"),
    Option("max_points", integer(3, "a whole number from 3"), 200, "largest number of solved loads"),
    Option("friction", positive, None, "coefficient of friction, for columns of partial slip; needs -tangential_share"),
    Option("tangential_share", real("above 0, at most 1", above=0, highest=1), None,
        "tangential load over friction times load; needs -friction"),
]  # fmt: skip
LAW_OPTIONS = [  # two replace those of app.solve
    *ARGUMENTS,
    Option("stiffness", flag, True, "compute stiffness and conductance; every law has a stiffness"),
    Option("output", word, None, f"-output or -o: file for the table, with the ending {' '.join(SUFFIXES)}"),
]  # fmt: skip
_HELP = """usage: python -m app.law -options_file petsc_options/hertz.opts -load_path 1000,100000 -o law.csv ...
       mpiexec -n 2 python -m app.law ...
Computes a table of load, approach, stiffness and other numbers, for finite element and multibody programs.
Lengths mm, forces N, stresses N/mm2. The range of the law; loads between its ends are solved first:"""
_SHOWN = ("load", "indentation", "mean_gap", "contact_fraction_corrected", "stiffness", "tangential_stiffness",
    "hydraulic_aperture_x")  # fmt: skip


class LawRequest(ProblemRequest):
    """Task of app.law.

    Attributes
    ----------
    arguments : dict
        Arguments of `ContactSolver.law`.
    """

    table = [*PROBLEM_OPTIONS, *LAW_OPTIONS]  # noqa: RUF012
    loadings = LOADINGS
    files = {"what": "law", "suffixes": SUFFIXES}  # noqa: RUF012

    def read_task(self, kind, value, options, parsed, inputs, comm):
        """Read the range of loads, and the options of the law. Collective."""
        if kind not in LOADINGS or len(value) < 2:
            raise InputError(f"-{kind}: must be -load_path or -mean_pressure_path, with two numbers or more")
        self.arguments = {kind.removesuffix("_path"): value}
        self.arguments |= {option.name: options[option.name] for option in ARGUMENTS}
        if options.given("friction") != options.given("tangential_share"):
            raise InputError("-friction and -tangential_share: only together")


def print_help():
    """Print the options on rank 0, without MPI and PETSc."""
    loadings, flow = (
        [option for option in PROBLEM_OPTIONS if option.name in names] for names in (LOADINGS, ["flow"])
    )
    lines = [
        _HELP,
        *(option.help() for option in loadings),
        "The table:",
        *(option.help() for option in (*LAW_OPTIONS, *flow)),
        "Problem, material and method: as python -m app.solve -help prints them.",
    ]
    if launched_rank(os.environ)[0] == 0:
        streams.print_output("\n".join(lines))


def main(parsed):
    """Solve for the law, write its table, and print it shortened. Collective. Return the exit status."""
    import sys
    import warnings

    with session.imports_uncollected():
        from app.api.arguments import check_disks
        from app.api.solver import ContactSolver
        from app.base.mpi import MPI
        from app.cli.load_path import merge_notes
        from app.io.table import format_text

    if "help" in parsed.petsc_options:
        print_help()
        return 0
    if not parsed.texts:
        start = "-options_file petsc_options/hertz.opts -load_path 1000,100000"
        raise InputError(f"nothing to solve; to begin with: {start}; all options: -help")
    comm = MPI.COMM_WORLD
    with suggest_names(parsed, LawRequest.table):
        request = LawRequest(parsed, comm)
        solver = ContactSolver(request.problem, request.method, request.options, prefix="")
    with solver, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RuntimeWarning)
        warnings.simplefilter("ignore", NoteWarning)  # they are in `notes`
        law = solver.law(**request.arguments, flow=request.flow, progress=sys.stderr.isatty())
    solver.options.insert_for_good(request.texts)
    if request.output:
        call_collectively(comm, law.save, request.output)
    shown = {name: f"{name} [{unit_of(name)}]".removesuffix(" [1]") for name in _SHOWN if name in law.table}
    columns = (law.table[name].tolist() for name in shown)
    rows = [dict(zip(shown.values(), row, strict=True)) for row in zip(*columns, strict=True)]
    session.print_output(format_text(rows).rstrip("\n"))
    where = f"table in {request.output}" if request.output else "the table is not saved; -o law.csv saves it"
    session.print_output(f"{len(rows)} loads, error of the interpolated load {law.error:.1e}; {where}")
    for line in [*merge_notes(law.notes), *dict.fromkeys(str(each.message) for each in caught)]:
        session.warn(line.replace("max_points", "-max_points"))
    call_collectively(comm, check_disks, solver.options.texts, only_root=True)
    return 0 if law.table["converged"].all() and law.error <= request.arguments["tolerance"] else 3
