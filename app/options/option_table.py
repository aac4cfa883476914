"""Tables of options, and a reader of values.

The texts of options come from files, environment and command line (`app.cli.option_sources`), or from a dict in a
program. Options of linear solvers (``-ksp_*``, ``-pc_*``, ``-mg_*``) belong to PETSc and are in no table.
"""

import difflib
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from app.base.errors import InputError, check_type, plain_number, shorten
from app.base.units import to_millimetres

LARGEST = 1e50  # 1 / LARGEST is the smallest number but 0: neither squares nor quotients overflow
REQUIRED = object()
# Names of other programs and books -> options.
USUAL_NAMES = {
    **dict.fromkeys(("e", "e1", "e2", "youngs_modulus", "young_modulus"), "young"),
    **dict.fromkeys(("nu", "nu1", "nu2", "poissons_ratio"), "poisson"),
    **dict.fromkeys(("force", "f", "normal_force", "fn"), "load"),
    **dict.fromkeys(("estar", "e_star", "reduced_modulus"), "contact_modulus"),
    **dict.fromkeys(("indentation", "penetration", "delta", "displacement"), "approach"),
}
_BOTH = {"young": "young E1,E2", "poisson": "poisson nu1,nu2"}  # options with the numbers of both bodies
# The program's option files: in an installed package, or in the folder of app/.
FILES = next(filter(Path.is_dir, (path / "petsc_options" for path in Path(__file__).parents)))


def find_option_file(path):
    """Return the path of an option file.

    `path` may be the name of a file in the folder `FILES`, and may lack the ending ``.opts``. If no file is found,
    `path` itself is returned.
    """
    for name in (path, f"{path}.opts"):
        own = FILES / Path(name).name
        if os.path.exists(name):  # noqa: PTH110: accepts names of any length
            return name
        if str(Path(name).parent) in (".", FILES.name) and os.path.isfile(own):  # noqa: PTH113
            return str(own)
    return path


def list_named_files(text):
    """Return the files that an option's text may mean.

    The names are the text itself, the text without ``:/DATASET``, and the file of a Python module.

    Examples
    --------
    >>> list_named_files("map.h5:/heights"), list_named_files("mine.Bump")
    (['map.h5:/heights', 'map.h5'], ['mine.Bump', 'mine.py'])
    """
    module = re.fullmatch(r"([^\W\d]\w*(\.[^\W\d]\w*)*)\.[^\W\d]\w*", text)
    names = text, text.rpartition(":")[0], module and f"{module[1].replace('.', '/')}.py"
    return [name for name in names if name]


@dataclass(frozen=True)
class Option:
    """An option: its name, kind, default value and meaning.

    `kind` is a function that converts a text to a value. If the text is not allowed, `kind` raises ValueError, and the
    message says what is allowed.
    """

    name: str
    kind: object
    default: object
    meaning: str

    @property
    def described(self):
        """Meaning of the option, and the allowed words."""
        names = getattr(self.kind, "names", ())
        return f"{self.meaning}: {', '.join(names)}" if names else self.meaning

    def help(self, files=None):
        """Return the line that describes this option in ``-help``.

        The line has the default, and the value of this option in each option file. `files` maps the names of these
        files to their options.
        """
        values = {} if self.default in (None, REQUIRED) else {"default": format_value(self.default)}
        for file, texts in (files or {}).items():
            if self.name in texts:
                values[file] = format_value(self.kind(texts[self.name]))
        shown = ", ".join(f"{source} {value}" for source, value in values.items())
        return f"  -{self.name:<20} {self.described}" + (f" ({shown})" if shown else "")


def format_value(value):
    """Format the value of an option as a user would type it.

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
    """Reader of the values of a table's options.

    `texts` maps names without dash to texts or numbers; names that are not in the table are ignored. The case of names
    does not matter, as in PETSc. The set `asked` has the names whose values were read.

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
        """Names of the options in the table."""
        return list(self._table)

    def given(self, *names):
        """Return whether any of the named options is set."""
        return any(name.lower() in self._texts for name in names)

    def __getitem__(self, name):
        """Return the value of an option, or its default.

        Raises InputError if the option is required and missing, or its text is not allowed.
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
        """Return the names of options set but not read."""
        return sorted(self._table.keys() & self._texts.keys() - self.asked)


def to_texts(options, what="options"):
    """Convert option values to texts, names to lower case.

    Raises InputError about `what` if `options` is not a mapping with names as keys.

    Examples
    --------
    >>> to_texts({"lcp_nested": True, "grid": (8, 4), "Load": 0.5, "lcp_monitor": ""})
    {'lcp_nested': 'true', 'grid': '8,4', 'load': '0.5', 'lcp_monitor': ''}
    """
    check_type(what, options, Mapping, "a mapping of names to values")
    if not all(isinstance(name, str) for name in options):
        raise InputError(f"{what}: {', '.join(map(repr, options))}: must be names of options")
    return {name.lower(): _to_text(value) for name, value in options.items()}


def _to_text(value):
    value = plain_number(value)
    if isinstance(value, bool | np.bool_):
        return str(value).lower()
    if isinstance(value, tuple | list | np.ndarray):
        return ",".join(map(_to_text, value))
    return "" if value is None else str(value)


def format_options(texts):
    """Format options as on command lines, sorted by name.

    Examples
    --------
    >>> format_options({"lcp_rtol": "1e-8", "grid": "8"})
    '-grid 8 -lcp_rtol 1e-8'
    """
    return " ".join(f"-{name} {texts[name]}".strip() for name in sorted(texts))


def find_similar_name(name, known):
    """Return the known name that a misspelt `name` may mean, or None.

    The known name differs by a few letters, or is another name of the same quantity. If `name` is known, return None.

    Examples
    --------
    >>> find_similar_name("gird", ["grid", "load"]), find_similar_name("grid", ["grid", "grip"])
    ('grid', None)
    >>> find_similar_name("E1", ["grid", "young"])
    'young'
    """
    if name in known:
        return None
    if (usual := USUAL_NAMES.get(name.lower())) in known:
        return usual
    return next(iter(difflib.get_close_matches(name, known, 1, max(0.75, 1 - 2 / max(len(name), 1)))), None)


def describe_unknown_options(names, known, what="unknown"):
    """List unknown options for a message, each with a similar known name.

    Examples
    --------
    >>> describe_unknown_options(["gird"], ["grid", "load"])
    'unknown option: -gird (did you mean -grid?)'
    >>> describe_unknown_options(["e1", "e2"], ["young", "load"])
    'unknown options: -e1, -e2 (did you mean -young E1,E2?)'
    """
    listed = {}  # advice -> names
    for name in sorted(names):
        near = find_similar_name(name, known)
        advice = f" (did you mean -{_BOTH.get(near, near)}?)" if near else ""
        listed.setdefault(advice, []).append(f"-{name}")
    parts = [f"{', '.join(ones)}{advice}" for advice, ones in listed.items()]
    return f"{what} option{'s'[: len(names) > 1]}: {', '.join(parts)}"


# Kinds of options (`Option.kind`): functions that parse a text, or return such a function


def lengths(kind):
    """Return the kind of lengths [mm] that may have units, from a `kind` of numbers."""
    return lambda text: kind(to_millimetres(text))


def number(text, kind=float, allowed="a number"):
    """Convert a text to a number of type `kind`.

    ValueError with the message `allowed` if the text is not a number or contains underscores.
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
    """Return a parser of a real number within limits.

    The limits are `lowest`, `above` (exclusive) and `highest`. inf is allowed only if `highest` is inf. A parser is a
    function that converts a text to a value.
    """
    return partial(_real, allowed=allowed, **limits)


def _several(text, kind, counts, allowed, fits):
    """Parse numbers separated by commas.

    `counts` are the allowed lengths of the list. The function ``fits(*numbers)`` tests all numbers together.
    """
    values = tuple(kind(part, allowed=allowed) for part in text.split(","))
    if len(values) not in counts or not fits(*values):
        raise ValueError(allowed)
    return values


_integer = partial(number, kind=int)


def integer(lowest, allowed, highest=np.inf):
    """Return a parser of integers from `lowest` to `highest`."""
    return lambda text: _several(text, _integer, [1], allowed, lambda n: lowest <= n <= highest)[0]


def pair(allowed, highest=np.inf):
    """Return a parser of two positive integers, or of one for both.

    The integers are at most `highest`.
    """

    def parse(text):
        numbers = _several(text, _integer, [1, 2], allowed, lambda *n: 1 <= min(n) <= max(n) <= highest)
        return numbers[0], numbers[-1]

    return parse


def pair_of_reals(allowed, nonzero=False, one=False, **limits):
    """Return a parser of two real numbers within the limits of `real`.

    With `one`, a single number stands for both.
    """
    kind, counts = partial(_real, **limits), [1, 2] if one else [2]

    def parse(text):
        numbers = _several(text, kind, counts, allowed, lambda *n: not (nonzero and 0 in n))
        return numbers[0], numbers[-1]

    return parse


def one_or_two_reals(allowed, **limits):
    """Return a parser of one or two real numbers, as a tuple."""
    kind = partial(_real, **limits)
    return lambda text: _several(text, kind, [1, 2], allowed, lambda *_: True)


def cells(text):
    """Parse ``i0,i1,j0,j1``, ranges of columns and rows.

    The columns are i0 to i1 - 1, the rows j0 to j1 - 1.
    """
    allowed = "i0,i1,j0,j1, whole numbers from 0 with i0 < i1 and j0 < j1"
    return _several(text, _integer, [4], allowed, lambda i0, i1, j0, j1: 0 <= i0 < i1 and 0 <= j0 < j1)


def domain(text):
    """Parse ``x0,x1,y0,y1``, the sides of a rectangle [mm]."""
    allowed = "x0,x1,y0,y1 with x0 < x1 and y0 < y1 [mm]"
    return _several(text, _real, [4], allowed, lambda x0, x1, y0, y1: x0 < x1 and y0 < y1)


def series(text):
    """Parse numbers and ranges, separated by commas.

    The range ``first:last:n`` means n numbers from first to last in equal steps, ``first:last:n:log`` n numbers in
    equal ratios.

    Examples
    --------
    >>> series("1:100:3:log"), series("0:1:3"), series("1,5,2"), series("0:2:3,1,0")
    ((1.0, 10.0, 100.0), (0.0, 0.5, 1.0), (1.0, 5.0, 2.0), (0.0, 1.0, 2.0, 1.0, 0.0))
    """
    allowed = "first:last:n, first:last:n:log with both above 0, n from 2 to 100000; or numbers a,b,c"
    numbers = []
    for part in text.split(","):
        try:
            if ":" not in part:
                numbers.append(_real(part))
                continue
            first, last, n, *spacing = part.split(":")
            first, last, n = _real(first), _real(last), number(n, int)
        except ValueError:
            raise ValueError(allowed) from None
        if spacing not in ([], ["log"]) or not 2 <= n <= 100000 or (spacing and min(first, last) <= 0):
            raise ValueError(allowed)
        numbers += (np.geomspace if spacing else np.linspace)(first, last, n).tolist()
    return tuple(numbers)


def choice(*names):
    """Return a parser that accepts a word of `names`."""

    def parse(text):
        if text not in names:
            raise ValueError(f"one of {', '.join(names)}")
        return text

    parse.names = names  # for the help
    return parse


def subset(*names):
    """Return a parser of comma-separated words from `names`."""

    def parse(text):
        chosen = tuple(text.split(","))
        if not set(chosen) <= set(names):
            raise ValueError(f"some, with commas between, of {', '.join(names)}")
        return chosen

    parse.names = names  # for the help
    return parse


def is_off(text):
    """Return whether PETSc takes a text as false."""
    return text.lower() in ("0", "false", "no", "off")


def flag(text):
    """Parse true or false; an empty text means true."""
    if text.lower() in ("", "1", "true", "yes", "on"):
        return True
    if is_off(text):
        return False
    raise ValueError("true or false")


def flag_or(*names):
    """Return a parser of true, false, or a word of `names`."""

    def parse(text):
        try:
            return text if text in names else flag(text)
        except ValueError:
            raise ValueError(f"true, false, {', '.join(names)}") from None

    parse.names = names  # for the help
    return parse


def word(text):
    """Accept any text that is not empty."""
    if not text:
        raise ValueError("a name")
    return text


positive = real("a positive number", above=0)
from_zero = real("a number from 0", lowest=0)
length, length_from_zero = lengths(positive), lengths(from_zero)
half = real("from 0 to 0.5", lowest=0, highest=0.5)  # Poisson's ratios
count = integer(1, "a whole number of at least 1")
