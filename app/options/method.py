"""Options of the method that solves a problem.

A method is a file of options, ``petsc_options/NAME.opts``. Without a method file, -ksp_type and -pc_type, the method is
`DEFAULT`, on periodic patches `PERIODIC`, and for thin incompressible layers `FILM`. Of several method files only the
last one is used. Single options override the options of the method file. A method uses one of these strategies
(-lcp_type):

==============  ======================================================================================
``active_set``  active set method of the paper, with any KSP: `app.contact`
``fast``        the default method, with TrackingCG: `app.methods.free`
``primal``      the default method on periodic patches, with CarryingCG: `app.methods.periodic`
``film``        the default method for thin incompressible layers: `app.methods.film`
``snesvi``      PETSc's solver of variational inequalities: `app.methods.snesvi`
==============  ======================================================================================
"""

import re
from dataclasses import dataclass, field, fields, replace

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

DEFAULT, PERIODIC, FILM = "fast", "primal", "film"

_tolerance = real("a number above 0 and below 1", above=0, highest=1 - 1e-9)
_cells = integer(0, "a whole number from 0")
_INEXACT = (DEFAULT, PERIODIC)
_DEFAULTS = (*_INEXACT, FILM)
_COPIES = ("active_set", "fast")
_ACTIVE_SET = ("active_set", *_DEFAULTS)
_STRATEGIES = (*_ACTIVE_SET, "snesvi")


@dataclass(frozen=True)
class MethodOption(Option):
    """A method's option, and where it has an effect.

    The option has an effect with the listed `strategies`; if `only_nested` is true, only with nested iteration.
    """

    strategies: tuple = _STRATEGIES
    only_nested: bool = False


def _option(kind, default, meaning, strategies=_STRATEGIES, only_nested=False):
    return field(default=default, metadata={"option": (kind, default, meaning, strategies, only_nested)})


# fmt: off
@dataclass(frozen=True)
class Settings:
    """Values of options ``-lcp_NAME``, and texts of all options."""

    type: str = _option(choice(*_STRATEGIES), "active_set", "strategy")
    nested: bool = _option(flag, False, "nested iteration (FMG): solve on coarser grids first", _ACTIVE_SET)
    rtol: float = _option(_tolerance, 1e-6,
        "largest relative residual of a solution, see docs/methods.md, What solved means")
    error_bound: float = _option(_tolerance, 0.01,
        "largest error_bound of a solution that counts as solved")
    max_it: int = _option(count, 100, "iterations in a row on one grid: active set, or those of snesvi")
    coarse_rtol: float = _option(from_zero, 0.0,
        "fast, primal, film: largest relative residual on coarser grids", _DEFAULTS, True)
    predictor: float = _option(from_zero, 0.0,
        "fast: share of the expected change of u by which cells enter C", ("fast",))
    defect_correction: float = _option(from_zero, 0.0,
        "fast, primal: use approximate products until this share of r is left; 0: never", _INEXACT)
    prolongation: str = _option(choice("copy", "lift"), "copy",
        "nested: prolong p as in the paper (copy), or by the FFT preconditioner (lift)", _COPIES, True)
    window: float = _option(from_zero, 0.0,
        "fast: use a window around contact, wider by this share; 0: all cells", ("fast",), True)
    beta: float = _option(from_zero, 0.003,
        "nested: start set after prolongation by copy, eq. (4.1)", _COPIES, True)
    coarsest: int = _option(count, 4, "do not coarsen a direction of up to this many cells", _ACTIVE_SET)
    cells_per_rank: int = _option(count, 8192,
        "least cells per rank on coarser grids and windows; otherwise fewer ranks work")
    shared_memory: bool = _option(flag, True,
        "ranks on one machine share memory for transforms")
    monitor: bool = _option(flag, False, "print a line for each active set iteration")
    precision: str = _option(choice("double", "single"), "double",
        "fast, primal: precision of products; solutions are verified in double", _INEXACT)
    texts: dict = field(default_factory=dict)
    warnings: tuple = ()
    replaceable: dict = field(default_factory=dict)  # options that a later choice may make useless -> method file

    @property
    def single(self):
        """True if the iteration's products are in single precision."""
        return self.precision == "single"
# fmt: on


METHOD_OPTIONS = [
    MethodOption(f"lcp_{one.name}", *one.metadata["option"]) for one in fields(Settings) if one.metadata
]
# Options that the preconditioners of this program read themselves, as PETSc's read -pc_*.
PART_OPTIONS = [
    Option("pc_circulant_extend", _cells, 0, "Circulant: cells of the extension past the contact edge"),
    Option("pc_circulant_blocks", _cells, 0, "Circulant: cells of blocks whose means start the extension; 0: zeros"),
    Option("pc_two_grid_sweeps", count, 2, "TwoGrid: sweeps after the coarse-grid correction, 1 to 50"),
]  # fmt: skip
_TABLE = {option.name: option for option in METHOD_OPTIONS}
# Options that choose other solvers, or switch parts of them off. They may make options of method files useless.
_CHOICE = re.compile(r"\w+_type|pc_mg_\w+|lcp_nested|lcp_prolongation")
_CHANGES = "what the linear solver makes is a change of the pressure, not PETSc's solution"
_REFUSED = {  # end of the name of an option of PETSc -> strategies that it spoils or aborts, and why
    "ksp_error_if_not_converged": (_DEFAULTS, "the default methods end linear solves early on purpose"),
    "ksp_guess_type": (
        (*_DEFAULTS, "snesvi"),
        "solutions of other contact sets do not fit the next one",
    ),
    "ksp_knoll": (_DEFAULTS, _CHANGES),
    "ksp_monitor_solution": (_DEFAULTS, _CHANGES),
    "ksp_monitor_error": (_STRATEGIES, "needs a PETSc DM, and the program has none"),
}
_NEED_CONTACT = (
    "mg",
    "sor",
    "eisenstat",
    "ContactMG",
)  # preconditioners of the operator on a contact set only
_NEED_ENTRIES = ("hypre", "hmg", "kaczmarz", "redistribute")  # preconditioners of PETSc that abort without


def find_method_file(name):
    """Return the path of a method file."""
    if name not in {path.stem for path in FILES.glob("*.opts")}:
        raise InputError(f"method {name!r}: must be one of {', '.join(list_methods())}")
    return FILES / f"{name}.opts"


def list_methods():
    """Return the names of all method files, sorted."""
    files = FILES.glob("*.opts")
    return sorted(path.stem for path in files if path.read_text("utf-8").startswith("# Method:"))


def read_method_file(name):
    """Return a method file's options: name -> text."""
    from app.options.solver_options import read_option_file  # loads PETSc

    return read_option_file(find_method_file(name))


def make_settings(method=None, options=None, periodic=False, thin_film=False):
    """Combine method files and options.

    `method` is the name of a method file, or a mapping from the names of option files, in order, to their options. The
    `options`, names without dash and values as texts or numbers, override the files' options. Raises InputError if an
    option is not allowed, or has no effect together with the other options. `thin_film` is the result of the kernel's
    `is_thin_film`. An option of a method file may have no effect if a later option has chosen other solvers.
    """
    typed = to_texts(options or {})
    if isinstance(method, str):
        method = {method: read_method_file(method)}
    files = {name: to_texts(texts, f"method {name!r}") for name, texts in (method or {}).items()}
    warnings = _drop_overridden_methods(files, typed)
    named = list(files)
    usual, other = (PERIODIC, DEFAULT) if periodic else (DEFAULT, PERIODIC)
    default = FILM if thin_film else usual
    texts = {name: text for source in (*files.values(), typed) for name, text in source.items()}
    chosen = texts.get("lcp_type", default)
    if not texts.keys() & {"ksp_type", "pc_type"} and chosen in (default, usual):
        files = {chosen: read_method_file(chosen), **files}
        texts = files[chosen] | texts
    if unknown := {name for name in texts if name.startswith("lcp_")} - _TABLE.keys():
        raise InputError(describe_unknown_options(unknown, _TABLE))
    replaceable, ignored = _find_replaceable(files, typed), []
    for name, needed in sorted(_find_useless(texts).items()):
        if name not in replaceable:
            option = f"-{name} {texts[name]}".rstrip()
            raise InputError(f"{option}: has no effect here; allowed with {needed}")
        del texts[name]
        ignored.append(name)
    reader = OptionReader(METHOD_OPTIONS, texts)
    if (strategy := reader["lcp_type"]) == other:
        kinds = "patches periodic in x and y (-periodic)", "other patches"
        works, this = kinds[::-1] if periodic else kinds
        allowed = f"{default}, {usual}" if thin_film else usual
        raise InputError(
            f"-lcp_type {strategy}: works on {works}; must be {allowed}, active_set or snesvi on {this}"
        )
    if strategy == FILM and not thin_film:
        raise InputError(
            f"-lcp_type {FILM}: works on thin, nearly incompressible layers on a rigid base; must be {usual}, "
            "active_set or snesvi for these bodies"
        )
    _check_solvers(strategy, texts)
    values = {name.removeprefix("lcp_"): reader[name] for name in _TABLE}
    replaceable = {name: file if file in named else "" for name, file in replaceable.items()}
    warnings += _note_ignored(ignored, replaceable)
    return Settings(**values, texts=texts, warnings=warnings, replaceable=replaceable)


def _is_method(texts):
    """Return whether options define a strategy, or a KSP and a PC."""
    return "lcp_type" in texts or {"ksp_type", "pc_type"} <= texts.keys()


def _drop_overridden_methods(files, typed):
    """Remove method files that later options override.

    `files` maps file names to options; `typed` are options outside of files. Return a warning for each removed file.
    """
    warnings, strategy, last = [], typed.get("lcp_type"), None
    for name in [name for name in reversed(files) if _is_method(files[name])]:
        mismatch = strategy is not None and files[name].get("lcp_type", "active_set") != strategy
        if winner := f"-lcp_type {strategy}" if mismatch else last:
            del files[name]
            warnings.insert(0, f"the method of {name} gives way to {winner}")
        else:
            last = name
    return tuple(warnings)


def _find_replaceable(files, typed):
    """Return method files' options that may have no effect, with the files.

    A later option has chosen another solver, so these options need not be used. The arguments are as in
    `_drop_overridden_methods`.
    """
    later, replaceable = set(typed), {}
    for file, texts in reversed(files.items()):
        if _is_method(texts) and any(map(_CHOICE.fullmatch, later)):
            replaceable |= dict.fromkeys(sorted(texts.keys() - later), file)
        later |= texts.keys()
    return replaceable


def _note_ignored(names, replaceable):
    """Return warnings on method files whose options are ineffective."""
    files = dict.fromkeys(filter(None, (replaceable[name] for name in names)))
    listed = {file: ", ".join(f"-{name}" for name in names if replaceable[name] == file) for file in files}
    text = "later options leave these without effect"
    return tuple(f"{file}: {text}: {options}" for file, options in listed.items())


def drop_unused(settings, unused, known):
    """Return settings without the unused replaceable options.

    `unused` are the names that no solver has read. Raises InputError if one of them is not replaceable; the message may
    suggest names in `known`, too.
    """
    if mistakes := set(unused).difference(settings.replaceable):
        ours = {option.name for option in (*METHOD_OPTIONS, *PART_OPTIONS)}
        raise InputError(describe_unknown_options(mistakes, ours.union(known), "unknown or unused"))
    texts = {name: text for name, text in settings.texts.items() if name not in unused}
    warnings = settings.warnings + _note_ignored(unused, settings.replaceable)
    return replace(settings, texts=texts, warnings=warnings)


def _find_useless(texts):
    """Return the options that have no effect, and what each would need.

    Options with their default value are not listed.
    """
    reader, useless = OptionReader(METHOD_OPTIONS, texts), {}
    for name in texts.keys() & _TABLE.keys():
        option = _TABLE[name]
        if reader[name] == option.default:
            continue
        if reader["lcp_type"] not in option.strategies:
            useless[name] = f"-lcp_type {' or '.join(option.strategies)} only"
        elif option.only_nested and not reader["lcp_nested"]:
            useless[name] = "-lcp_nested only"
        elif name == "lcp_beta" and reader["lcp_prolongation"] == "lift":
            useless[name] = "-lcp_prolongation copy only"
    return useless


def _check_solvers(strategy, texts):
    """Raise for PETSc options that spoil the strategy or abort PETSc."""
    has_bounds = any(name.endswith("ksp_chebyshev_eigenvalues") for name in texts)
    for name, text in texts.items():
        for end, (spoilt, reason) in _REFUSED.items():
            if name.endswith(end) and strategy in spoilt and not is_off(text):
                others = " or ".join(other for other in _STRATEGIES if other not in spoilt)
                allowed = f"; allowed with -lcp_type {others}" if others else ""
                raise InputError(f"-{name}: {reason}{allowed}")
        if name.endswith("ksp_view_diagonal_scale"):
            scale = name.replace("_view", "")
            if is_off(texts.get(scale, "off")):
                raise InputError(f"-{name}: nothing to view; allowed with -{scale}")
        if name.endswith("ksp_type") and text == "chebyshev" and not has_bounds:
            raise InputError(
                f"-{name} chebyshev: PETSc estimates its bounds before there is a contact set; needed: "
                f"-{name.removesuffix('type')}chebyshev_eigenvalues least,largest (0.5,30 with -pc_type jacobi)"
            )
        is_pc = name.endswith(("pc_type", "pc_python_type"))
        if is_pc and text.rpartition(".")[2] in _NEED_CONTACT and strategy == "snesvi":
            raise InputError(
                f"-{name} {text}: works on contact sets, {strategy} on submatrices; allowed with -lcp_type active_set"
            )
        if name.endswith("pc_type") and text in _NEED_ENTRIES:
            raise InputError(
                f"-{name} {text}: needs the entries of the matrix, which the program does not store"
            )
