"""Where options come from, in the order in which later ones override earlier ones.

1. ``~/.petscrc``, ``.petscrc``, ``petscrc``, unless ``-skip_petscrc`` is on the command line; ``PETSC_OPTIONS``. PETSc
   reads them when it starts.
2. The command line, with option files where they are named on it. What stands before a file is overridden by it, as in
   PETSc, with a warning.

Rank 0 alone reads files, by PETSc, and broadcasts the options. Files need to be on its host only.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from app.base.errors import InputError, format_yaml_error, shorten
from app.options.option_table import (
    FILES,
    Option,
    OptionReader,
    check_place,
    check_viewer,
    find_option_file,
    flag,
    is_off,
)

COMMAND_LINE = "on the command line"
STARTED_WITH = "in PETSC_OPTIONS or .petscrc"
MOST_FILES = 100  # option files that are read, each as often as it is included
LARGEST_FILE = 1 << 24  # bytes of an option file
_MOST_NODES = 10_000  # of YAML, each as often as aliases repeat it
_OPTION_FILES = ("-options_file", "-options_file_yaml")
# PETSc reads these when it ends; other options of its own it has read when it starts.
_READ_AT_END = (
    "help log_view options_left options_view memory_view objects_dump citations mpidump get_total_flops process_view "
    "debugger_pause nox tmp shared_tmp"
).split()
_FILES = ("citations", "history", "log_summary", "malloc_view")
_YES_OR_NO = ("options_view", "options_left", "get_total_flops", "mpidump")
_IN_FILE = re.compile(r"^[ \t]*--?(\w+)(?:[ \t]+\"?([^\s\"]+))?", re.MULTILINE)
_NO_TEXT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass(frozen=True)
class OptionSource:
    """A place that sets options: what it is called in messages, their names without dash in lower case, and texts.

    A command line with option files on it is several places, around the files.
    """

    description: str
    texts: dict
    file: str = ""  # its name, if it is one

    @property
    def names(self):
        """Names of the options."""
        return self.texts.keys()


@dataclass
class ParsedOptions:
    """All that the user has set.

    Attributes
    ----------
    texts : dict of str to str
        Name, without dash and in lower case -> text of the last place that sets it; without those that are PETSc's own
        affair.
    places : list of OptionSource
        In order.
    files : list of str
        Option files that were read.
    petsc_options : dict of str to str
        Options of PETSc that belong to no solver, ``-log_view`` for one.
    database_options : dict of str to str
        What PETSc's database must have of these, and of the command line.
    warnings : list of str
    """

    texts: dict
    places: list = field(default_factory=list)
    files: list = field(default_factory=list)
    petsc_options: dict = field(default_factory=dict)
    database_options: dict = field(default_factory=dict)
    warnings: list = field(default_factory=list)

    def select_alternative(self, alternatives, needed=""):
        """Which of some options excluding each other holds: that of the command line, else of the last place with any.

        Not collective. The others are removed from `texts`.

        Parameters
        ----------
        alternatives : sequence of str or tuple of str
            Names, or several that go together.
        needed : str
            Of what exactly one is needed, for the message; empty: none need be given.

        Returns
        -------
        str or tuple of str
            The alternative; None if none is given.

        Raises
        ------
        InputError
            If none is given, or more than one in that place.
        """
        members = {one: (one,) if isinstance(one, str) else one for one in alternatives}
        present = [one for one in alternatives if self.texts.keys() & members[one]]
        if not present:
            if not needed:
                return None
            raise InputError(f"neither {needed} is given: exactly one is needed")
        said = {}  # by places in order; the parts of the command line are one place as far as contradictions go
        for place in self.places:
            if ones := {one for one in present if place.names & set(members[one])}:
                said[place.description] = ones | said.pop(place.description, set())
        # What the command line says, wherever it stands, replaces what excludes it in a file.
        where = COMMAND_LINE if COMMAND_LINE in said else next(reversed(said), "")
        found = [one for one in present if one in said.get(where, present)]
        if len(found) > 1:
            both = "both " if len(found) == 2 else ""
            names = [next(name for name in members[one] if name in self.texts) for one in found]
            raise InputError(
                f"{both}{' and '.join(f'-{name}' for name in names)} are given {where}".rstrip()
                + ": exactly one is allowed"
            )
        for one in present:
            if one != found[0]:
                for name in members[one]:
                    self.texts.pop(name, None)
        return found[0]

    def split_by_source(self, wanted):
        """Options by where they come from.

        Parameters
        ----------
        wanted : set of str
            Names of the options that count.

        Returns
        -------
        files : dict of str to dict
            Name of an option file -> what it says; in order.
        words : dict of str to str
            What the command line says last.
        """
        files, last = {}, {}
        for place in self.places:
            texts = {name: text for name, text in place.texts.items() if name in wanted & self.texts.keys()}
            last |= dict.fromkeys(texts, place.description)
            if place.file and texts:
                files[place.file] = files.pop(place.file, {}) | texts
        return files, {name: self.texts[name] for name in sorted(last) if last[name] == COMMAND_LINE}

    def typed(self):
        """Names set on the command line or in an option file; others may be of other programs."""
        first = [place for place in self.places if place.description == STARTED_WITH]
        later = [place.names for place in self.places if place not in first]
        return self.texts.keys() - set().union(*(place.names for place in first)).difference(*later)


def startup_args(argv):
    """Words of the command line that PETSc starts with: all but option files and the help. Not collective.

    Raises
    ------
    InputError
        If a word is neither an option nor the value of one.
    """
    chosen = argv[:1]
    for name, text in _pairs(argv[1:]):
        if name in ("prefix_push", "prefix_pop"):
            raise InputError(f"-{name}: only in option files; write whole names on the command line")
        _check_traps({name: text or ""})
        if f"-{name}" not in _OPTION_FILES and name != "help":
            chosen += [f"-{name}"] if text is None else [f"-{name}", text]
    return chosen


def parse_options(argv):
    """Read all places.

    Not collective; PETSc must have been started.

    Parameters
    ----------
    argv : list of str
        The program's name, then the command line.

    Returns
    -------
    ParsedOptions

    Raises
    ------
    InputError
        If something cannot be read or is not understood; the message says where.
    """
    from petsc4py import PETSc

    from app.options.solver_options import is_used, options_with_prefix

    pairs, database = _pairs(argv[1:]), options_with_prefix("")
    words = {name for name, _ in pairs}
    started_with = OptionSource(
        STARTED_WITH, {name: text for name, text in database.items() if name not in words}
    )
    reader = _Reader()
    reader.places.append(started_with)
    for name, text in pairs:
        reader.take(name, text)
    texts = {name: text for place in reader.places for name, text in place.texts.items()}
    petsc_options = {name: text for name, text in texts.items() if name in _READ_AT_END or is_used(name)}
    _check_traps(texts)
    try:
        _check_end(petsc_options)
    except InputError:
        for name in petsc_options:  # or PETSc would complain, too, when it ends
            PETSc.Options().delValue(name)
        raise
    return ParsedOptions(
        texts={name: text for name, text in texts.items() if name not in petsc_options},
        places=reader.places,
        files=reader.files,
        petsc_options=petsc_options,
        database_options={
            name: text for name, text in texts.items() if name in petsc_options or name in words
        },
        warnings=list(_overridden(reader.places)),
    )


class _Reader:
    """Reads place after place."""

    def __init__(self):
        self.places, self.files = [], []

    def take(self, name, text):
        """Take an option of the command line, or an option file named there."""
        if f"-{name}" in _OPTION_FILES:
            if text is None:
                raise InputError(f"-{name}: a file name must follow")
            self._file(f"-{name}", find_option_file(text), ())
            return
        if self.places[-1].description != COMMAND_LINE:
            self.places.append(OptionSource(COMMAND_LINE, {}))
        self.places[-1].texts[name] = text or ""

    def _file(self, flag, path, inside):
        """Take an option file, after those it includes."""
        from app.options.solver_options import read_option_file

        path = os.path.expandvars(path)
        if len(self.files) >= MOST_FILES:
            raise InputError(
                f"option file {path}: more than {MOST_FILES} files are included; allowed: {MOST_FILES}"
            )
        content = _content(path, inside)
        identity, before = str(Path(path.removesuffix(":yaml")).resolve()), len(self.places)
        self.files.append(identity)
        yaml = (
            flag == _OPTION_FILES[1]
            or path.endswith((":yaml", ".yaml", ".yml", ".json"))
            or content.startswith(("---", "%YAML "))
        )
        if yaml:
            found, included = (
                [],
                [(_OPTION_FILES[1], file) for file in re.findall(r"!include\s+(\S+)", content)],
            )
            _check_yaml(content, f"option file {path}")
        else:
            content = re.sub("#.*", "", content)
            _check_quotes(content, f"option file {path}")
            found = [(name.lower(), text) for name, text in _IN_FILE.findall(content)]
            included = [(f"-{name}", file) for name, file in found if f"-{name}" in _OPTION_FILES and file]
        for inner_flag, inner in included:
            self._file(inner_flag, inner, (*inside, identity))
        of_included = set().union(*(place.names for place in self.places[before:]))
        mentioned = {name for name, _ in found}
        texts = read_option_file(path, _OPTION_FILES[yaml])
        own = {name: text for name, text in texts.items() if yaml or name not in of_included - mentioned}
        self.places.append(OptionSource(f"in {path}", own, path))


def _content(path, inside):
    """Text of an option file that the files `inside` include."""
    by = f" (included by {inside[-1]})" if inside else ""
    file = Path(path.removesuffix(":yaml"))
    try:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise InputError(f"option file {path}{by}: is not a regular file")
        if file.is_file() and file.stat().st_size > LARGEST_FILE:
            raise InputError(f"option file {path}{by}: is larger than {LARGEST_FILE >> 20} MiB")
        content = file.read_bytes().decode()
        if str(file.resolve()) in inside:
            raise InputError(f"option file {path}: includes itself{by}")
    except (OSError, RuntimeError) as error:
        own = (
            sorted(path.stem for path in FILES.glob("*.opts")) if isinstance(error, FileNotFoundError) else ()
        )
        own = f"; the program's own: {', '.join(own)}" if own else ""
        raise InputError(
            f"option file {path}{by}: {getattr(error, 'strerror', None) or error}{own}"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"option file {path}{by}: is not a text file") from None
    if _NO_TEXT.search(content):
        raise InputError(f"option file {path}{by}: is not a text file")
    return content


def _check_quotes(content, where):
    """Refuse a quote that is not closed: PETSc would read on behind the line."""
    for number, line in enumerate(content.split("\n"), 1):
        if line.count('"') % 2:
            raise InputError(f"{where}, line {number}: {shorten(line.strip())}: a quote is not closed")


def _check_yaml(content, where):
    """Refuse what is no YAML, and aliases that repeat each other without end, which PETSc would follow."""
    import yaml

    steps = count()

    def look(node):
        if next(steps) > _MOST_NODES:
            raise RecursionError(f"stands for more than {_MOST_NODES} nodes")
        if not isinstance(node, yaml.ScalarNode):
            for part in node.value:
                for inner in part if isinstance(part, tuple) else (part,):
                    look(inner)

    try:
        for document in yaml.compose_all(content, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            look(document)
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{where}{format_yaml_error(error, content)}") from None


def _overridden(places):
    """Complaints about files that override what stands before them on the command line."""
    for at, place in enumerate(places):
        later = places[at + 1 :]
        for name in sorted(place.names) if place.description == COMMAND_LINE else ():
            last = next((other for other in reversed(later) if name in other.names), None)
            if last and last.file and last.texts[name] != place.texts[name]:
                before, after = shorten(place.texts[name]), shorten(last.texts[name])
                yield f"-{name} {before}: {last.file} comes later and says {after}"


def _check_traps(texts):
    """Refuse to trap floating point errors."""
    if "fp_trap" in texts and not is_off(texts["fp_trap"]):
        raise InputError("-fp_trap: not available; holes of a body are NaN, with which numpy computes")


def _check_end(petsc_options):
    """Refuse what PETSc would only fail at when all is done."""
    for one in re.split(",(?=:)", petsc_options.get("log_view", "")):
        check_viewer("log_view", one)
    for name in petsc_options.keys() & set(_FILES):
        check_place(name, petsc_options[name], petsc_options[name])
    for name in petsc_options.keys() & set(_YES_OR_NO):
        OptionReader([Option(name, flag, False, "")], petsc_options)[name]


def _pairs(words):
    """Options of a command line without their dash, and their texts or None."""
    pairs, open_for_a_value = [], False
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise InputError(f"{word!a}: is not UTF-8 text") from None
        if re.match(r"-{0,2}[A-Za-z]\w*=", word) and (_is_option(word) or not open_for_a_value):
            name, text = word.split("=", 1)
            raise InputError(f"{shorten(word)}: needed: -{name.lstrip('-')} {shorten(text)}")
        if _is_option(word):
            pairs.append((word.removeprefix("-").lower(), None))
            open_for_a_value = True
        elif open_for_a_value:
            pairs[-1] = (pairs[-1][0], word)
            open_for_a_value = False
        else:
            raise InputError(f"{shorten(word)}: neither an option nor the value of one")
    return pairs


def _is_option(word):
    """Whether PETSc takes a word for an option, not for a value: -inf is a number."""
    number = re.match(r"-(inf(inity)?|nan)(?![a-z0-9_])", word, re.IGNORECASE)
    return re.match("--?[A-Za-z]", word) is not None and not number
