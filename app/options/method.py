"""How a problem is solved, from options: the method file, the options of this table, and PETSc's for the KSP.

A method is a file of options, ``petsc_options/NAME.opts``. Without one, and without a -ksp_type or -pc_type, it is the
default, `DEFAULT`; of several the last one counts, as a whole. Options given with it override. An option without effect
is refused, unless it stands in a method file and a later option has made it useless. The strategies (-lcp_type) are

==============  ======================================================================================
``active_set``  the paper's: `app.contact`, around any KSP
``fast``        the default method: `app.methods.free`, around TrackingCG
``primal``      the default method on periodic patches: `app.methods.periodic`, around CarryingCG
``tao``         PETSc's solvers of bound-constrained minimisation, `app.methods.reference_solvers`
``snesvi``      PETSc's solvers of variational inequalities, likewise
==============  ======================================================================================
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace

from app.base.errors import InputError
from app.options.option_table import (
    FILES,
    Option,
    OptionReader,
    choice,
    count,
    describe_unknown_options,
    flag,
    from_zero,
    integer,
    is_off,
    real,
    to_texts,
)
from app.options.solver_options import read_option_file

DEFAULT, PERIODIC = "fast", "primal"

_tolerance = real("a number above 0 and below 1", above=0, highest=1 - 1e-9)
_cells = integer(0, "a whole number from 0")
_ACTIVE_SET = ("active_set", "fast", "primal")
_STRATEGIES = (*_ACTIVE_SET, "tao", "snesvi")
_COPIES, _INEXACT = ("active_set", "fast"), ("fast", "primal")


@dataclass(frozen=True)
class MethodOption(Option):
    """An option of the method, and where it has an effect."""

    strategies: tuple = _STRATEGIES
    only_nested: bool = False


METHOD_OPTIONS = [
    MethodOption("lcp_type", choice(*_STRATEGIES), "active_set", "strategy"),
    MethodOption("lcp_nested", flag, False, "nested iteration (FMG): solve on coarser grids first", _ACTIVE_SET),
    MethodOption("lcp_rtol", _tolerance, 1e-6,
        "accepted ||r|| / ||h||, (5.1); fast: also 100 times, h on C; primal: std(h)"),
    MethodOption("lcp_error_bound", _tolerance, 0.01,
        "proved error (energy norm) up to which a solution counts as solved"),
    MethodOption("lcp_max_it", count, 100, "iterations in a row on one grid: active set, or those of tao and snesvi"),
    MethodOption("lcp_coarse_rtol", from_zero, 0.0,
        "fast: ||r|| / ||h|| on C enough on coarser grids; primal: as -lcp_rtol", _INEXACT, True),
    MethodOption("lcp_predictor", from_zero, 0.0,
        "fast: share of the change of u to be expected that step 4.b believes", ("fast",)),
    MethodOption("lcp_defect_correction", from_zero, 0.0,
        "fast, primal: by levels till this share of r is left; 0: by FFT", _INEXACT),
    MethodOption("lcp_prolongation", choice("copy", "lift"), "copy",
        "nested: of p, the paper's or by FFT preconditioner", _COPIES, True),
    MethodOption("lcp_window", from_zero, 0.0,
        "fast: work in a window around contact, wider by this share; 0: all cells", ("fast",), True),
    MethodOption("lcp_beta", from_zero, 0.003,
        "nested: start set after prolongation by copy, eq. (4.1)", _COPIES, True),
    MethodOption("lcp_coarsest", count, 4, "directions of up to this many cells are not coarsened", _ACTIVE_SET),
    MethodOption("lcp_cells_per_rank", count, 8192,
        "least cells of a rank on coarser grids and windows; else fewer ranks"),
    MethodOption("lcp_shared_memory", flag, True,
        "ranks on one machine send nothing for transforms: they share memory"),
    MethodOption("lcp_monitor", flag, False, "print a line for each active set iteration"),
    MethodOption("lcp_precision", choice("double", "single"), "double",
        "fast, primal: of products, verified in double", _INEXACT),
]  # fmt: skip
# Read by the preconditioners themselves, as -pc_* are.
PART_OPTIONS = [
    Option("pc_circulant_extend", _cells, 0, "Circulant: cells by which the residual is extended over the rim"),
    Option("pc_circulant_blocks", _cells, 0, "Circulant: cells of blocks whose means that begins with; 0: from zero"),
    Option("pc_two_grid_sweeps", count, 2, "TwoGrid: sweeps after the coarser grid, maybe before; at most 50"),
]  # fmt: skip
_TABLE = {option.name: option for option in METHOD_OPTIONS}
# An option so called chooses other solvers, or parts of them, which may not read what chosen ones would.
_CHOICE = re.compile(r"\w+_type|pc_mg_\w+")
_CHANGES = "what the linear solver makes is a change of the pressure, not PETSc's solution"
_REFUSED = {  # PETSc's options by how their names end: strategies that they spoil, or end, and why
    "ksp_error_if_not_converged": (
        (DEFAULT, PERIODIC),
        "the default methods end linear solves early on purpose",
    ),
    "ksp_guess_type": (
        (DEFAULT, PERIODIC, "tao", "snesvi"),
        "solutions of other contact sets do not fit the next one",
    ),
    "ksp_knoll": ((DEFAULT, PERIODIC), _CHANGES),
    "ksp_converged_rate": (("tao",), "PETSc crashes: TAO keeps no residuals of its linear solvers"),
    "ksp_monitor_error": (_STRATEGIES, "needs a DM of PETSc's, there is none"),
    "ksp_monitor_solution": ((DEFAULT, PERIODIC), _CHANGES),
}
_NEED_ENTRIES = ("hypre", "hmg", "kaczmarz", "redistribute")  # PETSc's preconditioners that crash without


@dataclass(frozen=True)
class Settings:
    """The options of the table, and the texts of all of them."""

    strategy: str
    nested: bool
    rtol: float
    error_bound: float
    max_it: int
    coarse_rtol: float
    predictor: float
    defect_correction: float
    lifted: bool
    window: float
    beta: float
    coarsest: int
    cells_per_rank: int
    shared_memory: bool
    monitor: bool
    single: bool
    texts: dict
    warnings: tuple = ()
    replaced: tuple = ()  # names in method files that may be useless, as something later chooses other solvers


def find_method_file(name):
    """Path of a method file by its name. Not collective.

    Raises
    ------
    InputError
        If there is none.
    """
    if name not in {path.stem for path in FILES.glob("*.opts")}:
        raise InputError(f"method {name!r}: allowed: {', '.join(list_methods())}")
    return FILES / f"{name}.opts"


def list_methods():
    """Names of all method files, sorted. Not collective."""
    return sorted(
        path.stem for path in FILES.glob("*.opts") if path.read_text("utf-8").startswith("# Method:")
    )


def read_method_file(name):
    """Options of a method file, name -> text. Not collective; PETSc reads them."""
    return read_option_file(find_method_file(name))


def make_settings(method=None, options=None, periodic=False):
    """Put a method together. Not collective.

    Parameters
    ----------
    method : str, or mapping of str to mapping, optional
        Name of a method file; or option files in order, name -> options.
    options : mapping, optional
        Names without dash, texts or numbers; they override the files'.
    periodic : bool
        Whether it is for a periodic patch, which has another default.

    Returns
    -------
    Settings

    Raises
    ------
    InputError
        If an option is not allowed, or has no effect with the others. What a file says may be idle if something later
        has overridden it.
    """
    given = to_texts(options or {})
    if isinstance(method, str):
        method = {method: read_method_file(method)}
    files = {name: to_texts(texts, f"method {name!r}") for name, texts in (method or {}).items()}
    warnings = _give_way(files, given)
    said = {name: text for texts in (*files.values(), given) for name, text in texts.items()}
    default = PERIODIC if periodic else DEFAULT
    if not said.keys() & {"ksp_type", "pc_type"} and said.get("lcp_type", default) == default:
        files = {default: read_method_file(default), **files}
    files_so_far, texts = [], {}
    for name in files:
        texts = texts | files[name]
        files_so_far.append((name, texts))
    of_files = tuple(sorted(texts.keys() - given.keys()))
    texts = texts | given
    if unknown := {name for name in texts if name.startswith("lcp_")} - _TABLE.keys():
        raise InputError(describe_unknown_options(unknown, _TABLE))
    replaced = _replaced(files, given)
    texts = _without_idle(texts, of_files, files_so_far)
    reader = OptionReader(METHOD_OPTIONS, texts)
    strategy = reader["lcp_type"]
    if strategy == (DEFAULT if periodic else PERIODIC):
        works, here = ("free patches", "periodic") if periodic else ("periodic patches (-periodic)", "free")
        raise InputError(
            f"-lcp_type {strategy}: works on {works}; allowed on {here} ones: {default}, active_set, tao, snesvi"
        )
    _refuse_what_fails(strategy, texts)
    return Settings(
        strategy,
        lifted=reader["lcp_prolongation"] == "lift",
        single=reader["lcp_precision"] == "single",
        **{
            part.name: reader[f"lcp_{part.name}"] for part in fields(Settings) if f"lcp_{part.name}" in _TABLE
        },
        texts=texts,
        warnings=tuple(warnings),
        replaced=tuple(sorted(replaced)),
    )


def _give_way(files, given):
    """Remove method files in whose place another one comes later, or another strategy; return a line for each.

    A file is a method if it chooses a strategy, or a KSP and a PC. Two of them mixed are neither.
    """
    warnings, wanted, kept = [], given.get("lcp_type"), None
    for name in reversed(list(files)):
        texts = files[name]
        if not _is_method(texts):
            continue
        other = wanted is not None and texts.get("lcp_type", "active_set") != wanted
        if later := f"-lcp_type {wanted}" if other else kept:
            del files[name]
            warnings.append(f"the method of {name} gives way to {later}")
        else:
            kept = name
    return warnings[::-1]


def _is_method(texts):
    """Whether a file with these options is a method file."""
    return "lcp_type" in texts or {"ksp_type", "pc_type"} <= texts.keys()


def _replaced(files, given):
    """Names in method files before others that choose solvers."""
    later, found = set(given), set()
    for texts in reversed(files.values()):
        if _is_method(texts) and any(map(_CHOICE.fullmatch, later)):
            found |= texts.keys() - later
        later |= texts.keys()
    return found


def drop_unused(chosen, unused, known):
    """Settings without unused options of replaced methods; refuse all other unused ones. Not collective.

    Parameters
    ----------
    chosen : Settings
    unused : iterable of str
    known : iterable of str
        Names like which one may have been meant.

    Raises
    ------
    InputError
    """
    if mistakes := set(unused).difference(chosen.replaced):
        ours = {option.name for option in (*METHOD_OPTIONS, *PART_OPTIONS)}
        raise InputError(describe_unknown_options(mistakes, ours.union(known), "unknown or unused"))
    return replace(chosen, texts={name: text for name, text in chosen.texts.items() if name not in unused})


def _without_idle(texts, of_files, files_so_far):
    """Texts without what files say that something later keeps from having an effect; refuse what else has none."""
    left = dict(texts)
    for name, needed in sorted(_idle(texts).items()):
        overridden = name in of_files and any(
            name in told and name not in _idle(told) for _, told in files_so_far
        )
        if not overridden:
            raise InputError(
                f"-{name} {texts[name]}".rstrip() + f": has no effect here; allowed with {needed}"
            )
        del left[name]
    return left


def _idle(texts):
    """Options that ask for something and can do nothing beside the others, and what they need: name -> text.

    Raises
    ------
    InputError
        If a value is not allowed.
    """
    reader, idle = OptionReader(METHOD_OPTIONS, texts), {}
    for name in texts.keys() & _TABLE.keys():
        option = _TABLE[name]
        if reader[name] == option.default:
            continue
        if reader["lcp_type"] not in option.strategies:
            idle[name] = f"-lcp_type {' or '.join(option.strategies)} only"
        elif option.only_nested and not reader["lcp_nested"]:
            idle[name] = "-lcp_nested only"
        elif name == "lcp_beta" and reader["lcp_prolongation"] == "lift":
            idle[name] = "-lcp_prolongation copy only"
    return idle


def _refuse_what_fails(strategy, texts):
    bounded = any(name.endswith("ksp_chebyshev_eigenvalues") for name in texts)
    for name, text in texts.items():
        for end, (spoilt, why) in _REFUSED.items():
            if name.endswith(end) and strategy in spoilt and not is_off(text):
                others = " or ".join(other for other in _STRATEGIES if other not in spoilt)
                raise InputError(f"-{name}: {why}" + (f"; allowed with -lcp_type {others}" if others else ""))
        if name.endswith("ksp_view_diagonal_scale"):
            scale = name.replace("_view", "")
            if is_off(texts.get(scale, "off")):
                raise InputError(f"-{name}: there is none to be viewed; needed: -{scale}")
        if name.endswith("ksp_type") and text == "chebyshev" and not bounded:
            raise InputError(
                f"-{name} chebyshev: PETSc estimates its bounds before there is a contact set; needed: "
                f"-{name.removesuffix('type')}chebyshev_eigenvalues least,largest (0.5,30 with -pc_type jacobi)"
            )
        if name.endswith("pc_type") and text in _NEED_ENTRIES:
            raise InputError(f"-{name} {text}: needs the entries of the matrix, which are never stored")
        # These work on parts of the operator, which are none of this program's.
        of_ours = name.endswith("python_type") and text.startswith("app.")
        if strategy not in _ACTIVE_SET and (of_ours or (name == "pc_type" and text == "mg")):
            raise InputError(
                f"-{name} {text}: works with active_set, fast and primal only, not with -lcp_type {strategy}"
            )
