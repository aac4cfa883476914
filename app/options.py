"""The options of ``app.solve``: name, kind, default, meaning, in one table.

PETSc's database holds them, so they come from option files, the environment and the command line alike; a
later one overrides an earlier one. Options of the linear solvers (``-ksp_*``, ``-pc_*``, ``-mg_*``) are PETSc's.
"""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from app.session import OPTION_FILES, InputError, option_names

LARGEST = 1e50  # and 1 / LARGEST the smallest number besides 0: neither squares nor quotients overflow


@dataclass(frozen=True)
class Option:
    """One option: its kind says how its text becomes a value and which values are allowed."""

    name: str
    kind: object
    default: object
    meaning: str

    @property
    def described(self):
        """Its meaning, and the words it may be."""
        names = getattr(self.kind, "names", ())
        return f"{self.meaning}: {', '.join(names)}" if names else self.meaning


def _real(text, lowest=-np.inf, above=-np.inf, highest=np.inf, allowed="a finite number"):
    try:
        value = float(text)
    except ValueError:
        raise ValueError(allowed) from None
    if not (np.isfinite(value) and lowest <= value <= highest and value > above):
        raise ValueError(allowed)
    if value and not 1 / LARGEST <= abs(value) <= LARGEST:
        raise ValueError(f"{allowed}, of size {1 / LARGEST:g} to {LARGEST:g}")
    return value


def real(allowed="a finite number", **limits):
    """Kind: one finite real number within limits."""
    return partial(_real, allowed=allowed, **limits)


def integer(lowest, allowed):
    """Kind: an integer, at least `lowest`."""

    def parse(text):
        try:
            value = int(text)
        except ValueError:
            raise ValueError(allowed) from None
        if value < lowest:
            raise ValueError(allowed)
        return value

    return parse


def choice(*names):
    """Kind: one of some words."""

    def parse(text):
        if text not in names:
            raise ValueError("one of " + ", ".join(names))
        return text

    parse.names = names  # for the help
    return parse


def flag(text):
    """Kind: on or off; the bare option means on."""
    if text.lower() in ("", "1", "true", "yes", "on"):
        return True
    if text.lower() in ("0", "false", "no", "off"):
        return False
    raise ValueError("true or false")


def word(text):
    """Kind: any non-empty text."""
    if not text:
        raise ValueError("a name must follow")
    return text


def _pair(text, allowed, fits):
    """Two whole numbers from 1, or one for both, that `fits` accepts."""
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(allowed) from None
    first, last = numbers[0], numbers[-1]
    if len(numbers) > 2 or min(numbers) < 1 or not fits(first, last):
        raise ValueError(allowed)
    return first, last


def grid_size(text):
    """Kind: ``nx,ny``, or ``n`` for both."""
    from petsc4py import PETSc

    most = np.iinfo(PETSc.IntType).max
    allowed = f"nx,ny or n, whole numbers of at least 1, and at most {most} cells"
    return _pair(text, allowed, lambda nx, ny: nx * ny <= most)


def frequencies(text):
    """Kind: ``M,N``, or ``M`` for both."""
    return _pair(text, "M,N or M, whole numbers from 1 to 10000", lambda m, n: max(m, n) <= 10000)


def domain(text):
    """Kind: ``x0,x1,y0,y1``."""
    allowed = "x0,x1,y0,y1 with x0 < x1 and y0 < y1 [mm]"
    try:
        x0, x1, y0, y1 = (_real(part) for part in text.split(","))
    except ValueError:
        raise ValueError(allowed) from None
    if not (x0 < x1 and y0 < y1):
        raise ValueError(allowed)
    return x0, x1, y0, y1


_positive = real("a positive number", above=0)
REQUIRED = object()

_from_zero = real("a number from 0", lowest=0)
_count = integer(1, "a whole number of at least 1")
TABLE = [
    Option("problem", choice("hertz", "punch", "file"), REQUIRED, "what is pressed together"),
    Option("grid", grid_size, REQUIRED, "nx,ny or n: cells"),
    Option("domain", domain, REQUIRED, "x0,x1,y0,y1: potential contact area [mm]"),
    Option("shear_modulus", _positive, REQUIRED, "combined G of the pair, 2/G = 1/G1 + 1/G2 [N/mm2]"),
    Option("poisson_ratio", real("from 0 to 0.5", lowest=0, highest=0.5), REQUIRED, "nu"),
    Option("approach", real(), None, "approach of the bodies [mm] (either this or -load)"),
    Option("load", real(), None, "total normal force [N] (either this or -approach)"),
    Option("hertz_rx", _positive, REQUIRED, "relative radius of curvature in x [mm]"),
    Option("hertz_ry", _positive, REQUIRED, "relative radius of curvature in y [mm]"),
    Option("punch_diameter", _positive, REQUIRED, "diameter of the flat punch [mm]"),
    Option("surface_seed", integer(0, "a whole number from 0"), 7, "seed of the random surface"),
    Option("surface_sigma", _from_zero, 0.1, "standard deviation of its heights [mm]"),
    Option("surface_decay", real("above 0, at most 1", above=0, highest=1), 0.8, "gamma: fall of its amplitudes"),
    Option("surface_modes", frequencies, (12, 10), "M,N: frequencies in x and y"),
    Option("gap_file", word, REQUIRED, "undeformed distance (ny, nx): .npy, .h5[:/dataset] or text; NaN: no contact"),
    Option("lcp_type", choice("active_set", "tao", "snesvi"), "active_set", "around a KSP, or PETSc's own"),
    Option("lcp_nested", flag, False, "nested iteration (FMG): solve on coarser grids first"),
    Option("lcp_rtol", _positive, 1e-6, "accepted ||r|| / ||h||, eq. (5.1); 100 times it with h on C"),
    Option("lcp_max_it", _count, 100, "iterations on one grid: active set, or those of tao and snesvi"),
    Option("lcp_coarse_rtol", _from_zero, 0.0, "tracking KSPs: residual that is enough on coarser grids"),
    Option("lcp_merge", _from_zero, 0.0, "tracking KSPs: step of a correction when cells are dropped"),
    Option("lcp_foresight", _from_zero, 0.0, "tracking KSPs: add cells by u and this much of its expected change"),
    Option("lcp_prolongation", choice("copy", "lift"), "copy", "of p: the paper's, or by an FFT"),
    Option("lcp_window", _from_zero, 0.0, "nested: work in a window around contact, with this margin; 0: all cells"),
    Option("lcp_beta", _from_zero, 0.003, "start set after prolongation, eq. (4.1)"),
    Option("lcp_coarsest", _count, 4, "directions of up to this many cells are not coarsened"),
    Option("lcp_replicate", _count, 64, "grids of up to this many cells squared are held by all ranks"),
    Option("lcp_cheap", flag, False, "stop below the discretisation error (nested iteration only)"),
    Option("lcp_precision", choice("double", "single"), "double", "of products; active_set checks answers in double"),
    Option("lcp_monitor", flag, False, "a line for each active set iteration"),
    Option("output", word, None, "result file (HDF5)"),
]  # fmt: skip
_BY_NAME = {option.name: option for option in TABLE}


class Options:
    """Reads options of the table from PETSc's database; what is never read counts as unused."""

    def __init__(self):
        from petsc4py import PETSc

        self._database = PETSc.Options()

    def given(self, name):
        """Whether the option is set. Not collective; does not count as reading it."""
        return any(key == name for key in self._database.getAll())

    def __getitem__(self, name):
        option = _BY_NAME[name]
        if not self._database.hasName(name):
            if option.default is REQUIRED:
                raise InputError(f"-{name} is missing: {option.described}")
            return option.default
        text = self._database.getString(name, "")
        try:
            return option.kind(text)
        except ValueError as error:
            wrong = f"-{name} {text}: not allowed" if text else f"-{name}: its value is missing"
            raise InputError(f"{wrong}; allowed: {error}") from None

    def text(self, name):
        """Text of any option, PETSc's own too; empty if not set. Not collective."""
        return self._database.getString(name, "")

    def all(self):
        """All options that are set and their texts. Not collective; does not count as reading them."""
        return self._database.getAll()

    def set(self, name, text):
        """Set an option as if the user had. Not collective."""
        self._database.setValue(name, text)

    def summary(self):
        """All options that are set, as one text. Not collective."""
        names = sorted(self._database.getAll())
        return " ".join(
            f"-{name} {self._database.getString(name, '')}".strip()
            for name in names
            if name != "options_file"
        )

    def drop(self, name):
        """Remove an option from the database."""
        self._database.delValue(name)


def loading(options, argv=None):
    """What is prescribed: ``("approach", mm)`` or ``("load", N)``.

    One of them in a later place (option file, then command line) replaces the other from an earlier one.

    Raises
    ------
    InputError
        If neither is given, or both in the same place.
    """
    names = ("approach", "load")
    chosen = None
    for place, tokens in _places(sys.argv if argv is None else argv):
        found = [name for name in names if f"-{name}" in tokens]
        if len(found) == 2:
            raise InputError(f"both -approach and -load are given {place}: exactly one is allowed")
        if found:
            chosen = found[0]
    present = [name for name in names if options.given(name)]
    if not present:
        raise InputError("neither -approach [mm] nor -load [N] is given: exactly one is needed")
    if len(present) == 2:
        if chosen is None:
            raise InputError("both -approach and -load are given: exactly one is allowed")
        options.drop(names[1 - names.index(chosen)])
        present = [chosen]
    return present[0], options[present[0]]


def _places(argv):
    """Yield (description, option names) of every place that sets options, in the order PETSc reads them."""
    yield "in PETSC_OPTIONS", shlex.split(os.environ.get("PETSC_OPTIONS", ""))
    for before, word in pairwise(argv):
        if before in OPTION_FILES:
            yield f"in {word}", option_names(word, before)
    yield "on the command line", argv


def _default(value):
    if value is REQUIRED or value is None:
        return ""
    if value is False:
        return " (off)"
    return f" (default {','.join(map(str, value)) if isinstance(value, tuple) else value})"


def help_text():
    """The options of the table, for ``-help``."""
    lines = ["Options of app.solve (lengths mm, forces N, stresses N/mm2):"]
    for option in TABLE:
        lines.append(f"  -{option.name:<20} {option.described}{_default(option.default)}")
    lines += [
        "Of the FFT preconditioner (-pc_type python -pc_python_type app.multigrid.circulant.Circulant):",
        f"  -{'pc_circulant_extend':<20} cells by which the residual is extended over the rim (default 0)",
        f"  -{'pc_circulant_margin':<20} share of the patch left free before it is continued periodically (default 0)",
    ]
    lines.append(
        "Linear solvers: PETSc's own -ksp_*, -pc_*, -mg_levels_*, -mg_coarse_*; see petsc_options/ and README.md."
    )
    return "\n".join(lines)
