"""Options of the command that are not the solver's: the problem, what is prescribed, the output."""

from __future__ import annotations

import numpy as np

from app.commands import load_path
from app.errors import InputError, agree
from app.halfspace.grid import SYMBOLS
from app.options import (
    REQUIRED,
    Option,
    OptionReader,
    as_line,
    choice,
    count,
    domain,
    flag,
    from_zero,
    integer,
    pair,
    positive,
    real,
    word,
)


def most_cells():
    """Largest number of cells that PETSc can number. Not collective."""
    from petsc4py import PETSc

    return int(np.iinfo(PETSc.IntType).max)


def grid_size(text):
    """Kind: ``nx,ny``, or ``n`` for both."""
    most = most_cells()
    allowed = f"nx,ny or n, whole numbers of at least 1, and at most {most} cells"
    return pair(allowed, lambda nx, ny: nx * ny <= most)(text)


share = real("above 0 and below 1", above=0, highest=1 - 1e-9)
frequencies = pair("M,N or M, whole numbers from 1 to 10000", lambda m, n: max(m, n) <= 10000)

PROBLEM_OPTIONS = [
    Option("problem", choice("hertz", "punch", "file", "python", "rough"), REQUIRED, "what is pressed together"),
    Option("grid", grid_size, REQUIRED, "nx,ny or n: cells"),
    Option("domain", domain, REQUIRED, "x0,x1,y0,y1: potential contact area [mm]"),
    Option("periodic", flag, False, "the patch repeats for ever in x and y"),
    Option("periodic_symbol", choice(*SYMBOLS), SYMBOLS[0], "what its numbers stand for, waves or cells"),
    Option("contact_modulus", positive, REQUIRED, "E* of the pair [N/mm2]; or else the next two"),
    Option("shear_modulus", positive, REQUIRED, "combined G of the pair, 2/G = 1/G1 + 1/G2 [N/mm2]"),
    Option("poisson_ratio", real("from 0 to 0.5", lowest=0, highest=0.5), REQUIRED, "nu"),
    Option("approach", real(), None, "approach of the bodies [mm] (this or one of the next three)"),
    Option("load", real(), None, "total normal force [N]"),
    Option("mean_pressure", real(), None, "load over the area of the patch [N/mm2]"),
    Option("mean_gap", real(), None, "mean gap of a periodic patch [mm]"),
    Option("hertz_rx", positive, REQUIRED, "relative radius of curvature in x [mm]"),
    Option("hertz_ry", positive, REQUIRED, "relative radius of curvature in y [mm]"),
    Option("punch_diameter", positive, REQUIRED, "diameter of the flat punch [mm]"),
    Option("surface_seed", integer(0, "a whole number from 0"), 7, "seed of the random surface"),
    Option("surface_sigma", from_zero, 0.1, "standard deviation of its heights [mm]"),
    Option("surface_decay", real("above 0, at most 1", above=0, highest=1), 0.8, "gamma: fall of its amplitudes"),
    Option("surface_modes", frequencies, (12, 10), "M,N: frequencies in x and y"),
    Option("surface_hurst", real("above 0, at most 1", above=0, highest=1), 0.8, "rough: Hurst exponent"),
    Option("surface_rolloff", positive, None, "rough: roll-off wavelength [mm] (default: longest side of the patch)"),
    Option("surface_cutoff", positive, REQUIRED, "rough: shortest wavelength [mm]"),
    Option("surface_rms_slope", from_zero, None, "rough: rms slope of its spectrum (either this or the next)"),
    Option("surface_rms_height", from_zero, None, "rough: rms height [mm]"),
    Option("gap_file", word, REQUIRED, "undeformed distance (ny, nx): .npy, .h5[:/dataset] or text; NaN: no contact"),
    Option("problem_type", word, REQUIRED, "python: module.Name or file.py:Name, a Problem or a function of x and y"),
    *load_path.OPTIONS,
    Option("stiffness", flag, False, "solve for the contact stiffness, too"),
    Option("refine_until", share, None, "finer and finer grids until the errors that cells make are below"),
    Option("refine_max", count, 4096**2, "refine_until: most cells"),
    Option("output", word, None, "result file (HDF5)"),
    Option("lcp_monitor", flag, False, "a line for each active set iteration"),
]  # fmt: skip
LOADING = ("approach", "load", "mean_pressure", "mean_gap", *(f"{kind}_path" for kind in load_path.KINDS))
MATERIAL = ("contact_modulus", ("shear_modulus", "poisson_ratio"))
ROUGHNESS = ("surface_rms_slope", "surface_rms_height")


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
    notes : list of str
        What the user should look at twice.

    Raises
    ------
    InputError
        On all ranks.
    """

    def __init__(self, given, comm):
        from app.output.files import check_output_path

        settle(given)
        options = reader_of(given)
        self.output = agree(comm, options.__getitem__, "output")
        if self.output:
            agree(comm, check_output_path, self.output, [*given.files, *input_files(given.texts)])
        self.problem, own, self.notes = agree(comm, make_problem, options, given.texts, comm)
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
        self.inputs = input_files(given.texts)
        self.wants_monitor = options["lcp_monitor"]
        if options.unused():
            raise InputError(unused(options.unused()))
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
    for alternatives in (LOADING, MATERIAL, ROUGHNESS):
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
    names = [texts[name] for name in ("gap_file", "problem_type") if name in texts]
    return [part for name in names for part in (name, name.rpartition(":")[0]) if part]


def make_problem(options, texts, comm):
    """Build the problem that the options describe.

    Not collective.

    Parameters
    ----------
    options : OptionReader
        Of `PROBLEM_OPTIONS`.
    texts : mapping of str to str
        All options, for a problem of the user's that has some of its own.
    comm : mpi4py.MPI.Comm
        Ranks that share the grid; this one looks at its rows only.

    Returns
    -------
    problem : app.problems.problem.Problem
    own : OptionReader
        Of the options that the problem has of its own; empty but for ``-problem python``.
    notes : list of str
        What the user should look at twice.

    Raises
    ------
    InputError, ValueError, OSError
        If something is missing or of no use.
    """
    from app.halfspace.grid import Grid, Slabs, check_memory

    name = options["problem"]
    material, periodic = _material(options), _periodic(options)
    own, notes = OptionReader((), {}), []
    if name == "file":
        problem, notes = _file_problem(options, material, periodic, comm)
        return problem, own, notes
    grid = Grid.from_domain(*options["grid"], options["domain"], periodic)
    check_memory(grid, comm.size)
    if name == "python":
        from app.problems import own as own_problems

        kind = own_problems.find(options["problem_type"])
        own = OptionReader(getattr(kind, "OPTIONS", ()), texts)
        problem = own_problems.make(kind, options["problem_type"], grid, material, own)
        own_problems.check(problem, options["problem_type"], Slabs.over(comm, grid.ny).rows)
        return problem, own, notes
    if name == "hertz":
        from app.problems.hertz import Hertz

        return Hertz(grid, material, options["hertz_rx"], options["hertz_ry"]), own, notes
    return (_rough if name == "rough" else _punch)(options, grid, material), own, notes


def _material(options):
    from app.halfspace.influence import Material

    if options.given("contact_modulus"):
        return Material.from_contact_modulus(options["contact_modulus"])
    if not (options.given("shear_modulus") or options.given("poisson_ratio")):
        raise InputError(
            "neither -contact_modulus [N/mm2] nor -shear_modulus [N/mm2] with -poisson_ratio is given: "
            "exactly one of the two ways is needed"
        )
    return Material(options["shear_modulus"], options["poisson_ratio"])


def _periodic(options):
    """Name of the periodic symbol, empty for a free patch."""
    if options["periodic"]:
        return options["periodic_symbol"]
    if options.given("periodic_symbol"):
        raise InputError("-periodic_symbol: has no effect here; allowed with -periodic")
    return ""


def _file_problem(options, material, periodic, comm):
    from app.halfspace.grid import Grid, Slabs, check_memory
    from app.problems.gap_file import GapArray, GapFile

    gap = GapArray(options["gap_file"])
    ny, nx = gap.shape
    notes = []
    if options.given("grid"):
        nx, ny = options["grid"]
    elif nx * ny > most_cells():
        raise InputError(f"gap file {gap.name}: has {nx} x {ny} cells; at most {most_cells()} are possible")
    elif nx == 3 and ny > 9:
        notes.append(f"gap file {gap.name}: taken for {ny} rows of 3 cells, not for points x, y, z")
    problem = GapFile(Grid.from_domain(nx, ny, options["domain"], periodic), material, gap)
    check_memory(problem.grid, comm.size)
    gap.check(Slabs.over(comm, ny).rows)
    return problem, notes


def _punch(options, grid, material):
    from app.problems.punch import Punch
    from app.problems.surfaces import WavySurface

    x0, x1, y0, y1 = options["domain"]
    surface = WavySurface(
        modes=options["surface_modes"], decay=options["surface_decay"], sigma=options["surface_sigma"],
        seed=options["surface_seed"], extent=(x1 - x0, y1 - y0), origin=(x0, y0),
    )  # fmt: skip
    return Punch(grid, material, options["punch_diameter"], surface)


def _rough(options, grid, material):
    from app.problems.rough import Rough, check_cut_off
    from app.problems.surfaces import SelfAffineSurface

    given = {name: options[f"surface_{name}"] for name in ("rms_slope", "rms_height")}
    if not any(options.given(name) for name in ROUGHNESS):
        raise InputError(
            "neither -surface_rms_slope nor -surface_rms_height [mm] is given: exactly one is needed"
        )
    check_cut_off(grid, options["surface_cutoff"])  # before as many waves are made
    x0, x1, y0, y1 = options["domain"]
    rolloff = options["surface_rolloff"] or max(x1 - x0, y1 - y0)
    surface = SelfAffineSurface(
        options["surface_hurst"], rolloff, options["surface_cutoff"], (x1 - x0, y1 - y0), options["surface_seed"],
        origin=(x0, y0), **given,
    )  # fmt: skip
    return Rough(grid, material, surface)


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
