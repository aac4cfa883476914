"""Options as tables: name, kind, default, meaning; and a reader of their values from a mapping of texts.

The texts may come from anywhere: `app.cli.option_sources` reads files, the environment and the command line, a
program has a dict. Options of the linear solvers (``-ksp_*``, ``-pc_*``, ``-mg_*``) are PETSc's and in no table.
"""

from __future__ import annotations

import difflib
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from app.base.errors import InputError, shorten

LARGEST = 1e50  # and 1 / LARGEST the smallest number besides 0: neither squares nor quotients overflow
REQUIRED = object()
_VIEWERS = "ascii", "binary", "draw", "hdf5", "matlab", "saws", "socket", "string", "vtk"
_TEXT = {("ascii", "default")}
_DRAWN = _TEXT | {("draw", "default"), ("draw", "draw_lg")}
# What PETSc can show of an option, viewer and format; it crashes at any other.
_CAN_SHOW = [
    (r"(\w+_)?ksp_monitor(_true_residual|_solution)?", _DRAWN),
    (r"(\w+_)?ksp_monitor_(short|range|max|singular_value)|snes_converged_reason", _TEXT),
]
# The program's option files: inside of an installed package, beside app/ in a checkout.
FILES = next(filter(Path.is_dir, (path / "petsc_options" for path in Path(__file__).parents)))


def find_option_file(path):
    """Path of an option file: as it is, or one of the program's own where ``petsc_options/F`` or ``F`` is none here.

    Where there is neither, the same with ``.opts``.
    """
    for name in (path, f"{path}.opts"):
        own = FILES / Path(name).name
        if os.path.exists(name):  # noqa: PTH110: no name is too long for it
            return name
        if str(Path(name).parent) in (".", FILES.name) and os.path.isfile(own):  # noqa: PTH113
            return str(own)
    return path


def list_named_files(text):
    """Names of files that the text of an option may hold: all of it, what stands before ``:/DATASET``, or a module.

    Examples
    --------
    >>> list_named_files("map.h5:/heights"), list_named_files("mine.Bump")
    (['map.h5:/heights', 'map.h5'], ['mine.Bump', 'mine.py'])
    """
    module = re.fullmatch(r"([^\W\d]\w*(\.[^\W\d]\w*)*)\.[^\W\d]\w*", text)
    names = text, text.rpartition(":")[0], module and f"{module[1].replace('.', '/')}.py"
    return [name for name in names if name]


def check_viewer(name, text):
    """Refuse a viewer of PETSc, ``KIND:FILE:FORMAT``, that does not exist or cannot show the option.

    Not collective. PETSc itself checks it only when there is something to view, or not at all.

    Raises
    ------
    InputError
    """
    kind, file, form, *_ = [*text.split(":"), "", ""]
    if kind not in ("", *_VIEWERS):
        raise InputError(
            f"-{name} {shorten(text)}: allowed: nothing, or ascii:FILE:FORMAT, with any of {', '.join(_VIEWERS)}"
        )
    for pattern, shown in _CAN_SHOW:
        if re.fullmatch(pattern, name) and (kind or "ascii", form.lower() or "default") not in shown:
            kinds = ", ".join(sorted({f"{kind}:FILE" if kind == "ascii" else kind for kind, _ in shown}))
            raise InputError(f"-{name} {text}: PETSc cannot show it so; allowed: nothing, or {kinds}")
    if kind not in ("draw", "socket"):
        check_place(name, text, file)


def check_place(name, text, file):
    """Refuse a file that PETSc is to write, by the option `name` with some text, where there can be none.

    Not collective.

    Raises
    ------
    InputError
    """
    folder = Path(file).parent
    if not folder.is_dir():
        raise InputError(f"-{name} {text}: there is no folder {folder}")
    if file and Path(file).is_dir():
        raise InputError(f"-{name} {text}: {file} is a folder")
    if file and not os.access(file if Path(file).exists() else folder, os.W_OK):
        raise InputError(f"-{name} {text}: {file} cannot be written")


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

    def help(self, files=None):
        """Return a line for ``-help``, with the values in some option files: name -> texts of its options."""
        values = {} if self.default in (None, REQUIRED) else {"default": format_value(self.default)}
        for file, texts in (files or {}).items():
            if self.name in texts:
                values[file] = format_value(self.kind(texts[self.name]))
        said = ", ".join(f"{place} {value}" for place, value in values.items())
        return f"  -{self.name:<20} {self.described}" + (f" ({said})" if said else "")


def format_value(value):
    """Write a value as one would type it; nothing for None or `REQUIRED`.

    Examples
    --------
    >>> format_value(1e-6), format_value((12, 10)), format_value(True), format_value(None)
    ('1e-06', '12,10', 'on', '')
    """
    if value is None or value is REQUIRED:
        return ""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return ",".join(map(format_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


class OptionReader:
    """Values of the options of a table.

    Not collective.

    Parameters
    ----------
    table : iterable of Option
    texts : mapping of str to str or number
        Names without dash; names are compared without regard to case, as PETSc does. Names that are not in the
        table are none of the reader's business.

    Attributes
    ----------
    asked : set of str
        Names whose value somebody wanted so far.

    Examples
    --------
    >>> reader = OptionReader([Option("load", real(), REQUIRED, "force [N]")], {"Load": 7, "ksp_rtol": "0.1"})
    >>> reader["load"], reader.given("load"), reader.unused()
    (7.0, True, [])
    """

    def __init__(self, table, texts):
        self._table = {option.name.lower(): option for option in table}
        self._texts = to_texts(texts)
        self.asked = set()

    @property
    def names(self):
        """Names of the table's options."""
        return list(self._table)

    def given(self, *names):
        """Whether one of some options is set; does not count as asking for it."""
        return any(name.lower() in self._texts for name in names)

    def __getitem__(self, name):
        """Value of an option, or its default.

        Raises
        ------
        InputError
            If it is needed and not given, or its text is not allowed.
        """
        name = name.lower()
        option = self._table[name]
        self.asked.add(name)
        if name not in self._texts:
            if option.default is REQUIRED:
                raise InputError(f"-{name} is missing: {option.described}")
            return option.default
        text = self._texts[name]
        try:
            return option.kind(text)
        except ValueError as error:
            wrong = f"-{name} {shorten(text)}" if text else f"-{name}: its value is missing"
            unit = re.search(r"\[[^]:]+\]", option.meaning)
            unit = f" {unit[0]}" if unit and unit[0] not in str(error) else ""
            raise InputError(f"{wrong}: must be {error}{unit}") from None

    def unused(self):
        """Names of the table's options that are set and that nobody has asked for, sorted."""
        return sorted(self._table.keys() & self._texts.keys() - self.asked)


def to_texts(options, what="options"):
    """Options of a mapping as they would be written on a command line: names in lower case, values as text.

    Raises
    ------
    InputError
        If it is something else; `what` it should be.

    Examples
    --------
    >>> to_texts({"lcp_nested": True, "grid": (8, 4), "Load": 0.5, "lcp_monitor": ""})
    {'lcp_nested': 'true', 'grid': '8,4', 'load': '0.5', 'lcp_monitor': ''}
    """
    if not isinstance(options, Mapping):
        raise InputError(f"{what}: is {type(options).__name__}; needed: a mapping of names to values")
    if not all(isinstance(name, str) for name in options):
        raise InputError(f"{what}: {', '.join(map(repr, options))}: needed: names of options")
    return {name.lower(): _text(value) for name, value in options.items()}


def format_options(texts):
    """Options as they would be written on a command line.

    Examples
    --------
    >>> format_options({"lcp_rtol": "1e-8", "grid": "8"})
    '-grid 8 -lcp_rtol 1e-8'
    """
    return " ".join(f"-{name} {texts[name]}".strip() for name in sorted(texts))


def _text(value):
    if isinstance(value, bool | np.bool_):
        return str(value).lower()
    if isinstance(value, tuple | list | np.ndarray):
        return ",".join(map(_text, value))
    return "" if value is None else str(value)


def find_similar_name(name, known):
    """The known name that differs by two letters at most, of a short name by a quarter; None if there is none.

    Examples
    --------
    >>> find_similar_name("gird", ["grid", "load"]), find_similar_name("grid", ["grid", "grip"])
    ('grid', None)
    """
    if name in known:
        return None
    return next(iter(difflib.get_close_matches(name, known, 1, max(0.75, 1 - 2 / max(len(name), 1)))), None)


def describe_unknown_options(names, known, what="unknown"):
    """Complain about unknown options; suggest a known name that is nearly the same.

    Parameters
    ----------
    names : iterable of str
    known : container of str
    what : str
        What they are called.

    Examples
    --------
    >>> describe_unknown_options(["gird"], ["grid", "load"])
    'unknown option: -gird (did you mean -grid?)'
    """
    said = []
    for name in sorted(names):
        near = find_similar_name(name, known)
        said.append(f"-{name} (did you mean -{near}?)" if near else f"-{name}")
    return f"{what} option{'s'[: len(said) > 1]}: {', '.join(said)}"


# ------------------------------------------------------------------------------------------------- kinds


def number(text, kind=float, allowed="a number"):
    """The number that a text is, by Python's type `kind`, but without the underscores that Python takes.

    Not collective.

    Raises
    ------
    ValueError
        If it is none; the message is `allowed`.
    """
    try:
        if "_" in text:
            raise ValueError
        return kind(text)
    except ValueError:
        raise ValueError(allowed) from None


def _real(text, lowest=-np.inf, above=-np.inf, highest=sys.float_info.max, allowed="a finite number"):
    value = number(text, float, allowed)
    if not (lowest <= value <= highest and value > above):
        raise ValueError(allowed)
    if 0 < abs(value) < 1 / LARGEST or LARGEST < abs(value) < np.inf:
        raise ValueError(f"{allowed}, of size {1 / LARGEST:g} to {LARGEST:g}")
    return value


def real(allowed="a finite number", **limits):
    """Kind: one real number within limits; inf is one if it is the highest."""
    return partial(_real, allowed=allowed, **limits)


def _whole(text, allowed):
    return number(text, int, allowed)


def _several(text, kind, count, allowed, fit):
    """So many parts with commas between, each of a kind, that are allowed together."""
    values = tuple(kind(part, allowed=allowed) for part in text.split(","))
    if len(values) != count or not fit(*values):
        raise ValueError(allowed)
    return values


def integer(lowest, allowed, highest=np.inf):
    """Kind: an integer from `lowest` to `highest`."""

    def parse(text):
        [value] = _several(text, _whole, 1, allowed, lambda value: lowest <= value <= highest)
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


def subset(*names):
    """Kind: some of some words, with commas between, in any order."""

    def parse(text):
        found = tuple(text.split(","))
        if not set(found) <= set(names):
            raise ValueError("some, with commas between, of " + ", ".join(names))
        return found

    parse.names = names  # for the help
    return parse


def is_off(text):
    """Whether a text switches off, as PETSc reads it, too. Not collective."""
    return text.lower() in ("0", "false", "no", "off")


def flag(text):
    """Kind: on or off; the bare option means on."""
    if text.lower() in ("", "1", "true", "yes", "on"):
        return True
    if is_off(text):
        return False
    raise ValueError("true or false")


def word(text):
    """Kind: any non-empty text."""
    if not text:
        raise ValueError("a name")
    return text


def pair(allowed, highest=np.inf):
    """Kind: two whole numbers from 1 to a highest one, or one for both."""

    def parse(text):
        count = 2 if "," in text else 1
        numbers = _several(text, _whole, count, allowed, lambda *n: 1 <= min(n) <= max(n) <= highest)
        return numbers[0], numbers[-1]

    return parse


def pair_of_reals(allowed, nonzero=False, **limits):
    """Kind: two real numbers within limits, see `real`."""
    kind = partial(_real, **limits)
    return partial(_several, kind=kind, count=2, allowed=allowed, fit=lambda *n: not (nonzero and 0 in n))


def cells(text):
    """Kind: ``i0,i1,j0,j1``, a range of columns and one of rows."""
    allowed = "i0,i1,j0,j1, whole numbers from 0 with i0 < i1 and j0 < j1"
    return _several(text, _whole, 4, allowed, lambda i0, i1, j0, j1: 0 <= i0 < i1 and 0 <= j0 < j1)


def series(text):
    """Kind: ``first:last:n`` or ``first:last:n:log``, n numbers from first to last, or some with commas between.

    Examples
    --------
    >>> series("1:100:3:log"), series("0:1:3"), series("1,5,2")
    ((1.0, 10.0, 100.0), (0.0, 0.5, 1.0), (1.0, 5.0, 2.0))
    """
    allowed = "first:last:n, first:last:n:log with both above 0, n from 2 to 100000; or numbers a,b,c"
    try:
        if ":" not in text:
            return tuple(_real(part) for part in text.split(","))
        first, last, n, *spacing = text.split(":")
        first, last, n = _real(first), _real(last), number(n, int)
    except ValueError:
        raise ValueError(allowed) from None
    if spacing not in ([], ["log"]) or not 2 <= n <= 100000 or (spacing and min(first, last) <= 0):
        raise ValueError(allowed)
    return tuple((np.geomspace if spacing else np.linspace)(first, last, n).tolist())


def domain(text):
    """Kind: ``x0,x1,y0,y1``."""
    allowed = "x0,x1,y0,y1 with x0 < x1 and y0 < y1 [mm]"
    return _several(text, _real, 4, allowed, lambda x0, x1, y0, y1: x0 < x1 and y0 < y1)


positive = real("a positive number", above=0)
from_zero = real("a number from 0", lowest=0)
half = real("from 0 to 0.5", lowest=0, highest=0.5)  # Poisson's ratios
count = integer(1, "a whole number of at least 1")
