"""Where options come from, in the order in which later ones override earlier ones.

1. ``~/.petscrc``, ``.petscrc``, ``petscrc``, unless ``-skip_petscrc`` is on the command line,
2. ``PETSC_OPTIONS``, then ``PETSC_OPTIONS_YAML``,
3. the command line, with option files where they are named on it: what stands before a file gives way to it, as in
   PETSc, and is told.

Rank 0 alone reads all that, by PETSc's own reading, into private databases, and tells the others: files need to be on
its host only, and what is wrong with them is one error for all ranks.
"""

from __future__ import annotations

import os
import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path

from app.commands.option_text import OPTION_FILES, bare, is_option, look_into, look_over_yaml
from app.errors import InputError, quoted
from app.options import Option, OptionReader, check_place, check_viewer, flag, is_off, option_file

COMMAND_LINE = "on the command line"
MOST_FILES = 100  # option files that are read, each as often as it is included

# PETSc's options that are none of a solver's: most of them must be there when PETSc starts ...
_OF_PETSC = re.compile(
    r"help|version|skip_petscrc|petsc_(ci\w*|sleep)|log(_(all|exclude(_actions|_objects)?|summary|sync|threshold|trace|view(_gpu_time|_memory)?))?"
    r"|options_(left|view|monitor|monitor_cancel|suppress_deprecated_warnings)|info(_exclude)?|memory_view"
    r"|malloc(_(coalesce|debug|dump|hbw|info|requested_size|test|view|view_threshold))?|objects_dump|on_error_\w+"
    r"|error_output_(none|stdout)|fp_trap|debug_terminal|debugger_(nodes|pause|ranks)|start_in_debugger"
    r"|stop_for_debugger|check(_pointer_intensity|functionlist|stack)|get_total_flops|nox(_warning)?|display|x_virtual"
    r"|citations|history|mpi_return_on_error|mpidump|use_gpu_aware_mpi|device_\w+|dll_\w+|saws_\w+",
    re.IGNORECASE,
)
# ... and these may come later, from a file.
_LATER = re.compile(
    r"help|skip_petscrc|log|log_(all|view)|options_(left|view)|objects_dump|get_total_flops|citations"
)
_FILES = "citations", "history", "log_summary", "malloc_view"
_YES_OR_NO = "options_view", "options_left", "get_total_flops", "mpidump"


@dataclass(frozen=True)
class Place:
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
class Given:
    """All that the user has set.

    Attributes
    ----------
    texts : dict of str to str
        Name, without dash and in lower case -> text of the last place that sets it; without those that are PETSc's own
        affair.
    places : list of Place
        In order.
    files : list of str
        Option files that were read.
    of_petsc : dict of str to str
        Options of PETSc that belong to no solver, ``-log_view`` for one.
    warnings : list of str
    """

    texts: dict
    places: list = field(default_factory=list)
    files: list = field(default_factory=list)
    of_petsc: dict = field(default_factory=dict)
    warnings: list = field(default_factory=list)

    def last_of(self, alternatives, needed=""):
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

    def files_and_words(self, wanted):
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
            What is said last elsewhere: on the command line or in the environment.
        """
        files, last = {}, {}
        for place in self.places:
            texts = {name: text for name, text in place.texts.items() if name in wanted & self.texts.keys()}
            last |= dict.fromkeys(texts, place.file)
            if place.file and texts:
                files[place.file] = files.pop(place.file, {}) | texts
        return files, {
            name: self.texts[name] for name in sorted(wanted & self.texts.keys()) if not last.get(name)
        }


def for_the_start(argv, environment):
    """Words of the command line and PETSC_OPTIONS that PETSc must see when it starts; it has to skip all files.

    Not collective; needs no PETSc.

    Raises
    ------
    InputError
        If a word is neither an option nor the value of one.
    """
    chosen, pairs = [], _environment_pairs(environment) + _pairs(argv[1:])
    for name, text in pairs:
        if len(pairs) == 1 and bare(name) == "help":
            continue  # our own is help enough; beside a problem PETSc tells the options of what it uses
        if _OF_PETSC.fullmatch(bare(name)):
            if bare(name) == "fp_trap" and not is_off(text or ""):
                raise InputError(
                    "-fp_trap: not available; holes of a body are NaN, with which numpy computes"
                )
            _check_end(bare(name), text)
            chosen += [name] if text is None else [name, text]
    # A debug build would tell of unused options in the end; those of the solvers are looked after by `app.solver`.
    return [*argv[:1], "-options_left", "no", *chosen, "-skip_petscrc"]


def read(argv, environment):
    """Read all places.

    Not collective; PETSc must have been started.

    Parameters
    ----------
    argv : list of str
        The program's name, then the command line.
    environment : mapping of str to str

    Returns
    -------
    Given

    Raises
    ------
    InputError
        If something cannot be read or is not understood; the message says where.
    """
    line = _pairs(argv[1:])
    reader = _Reader()
    if not any(name.lower() == "-skip_petscrc" for name, _ in line):
        for path in _start_files(environment):
            reader.take([("-options_file", path)], "")
    reader.take(_environment_pairs(environment), "in PETSC_OPTIONS")
    if environment.get("PETSC_OPTIONS_YAML"):
        reader.take([("-options_string_yaml", environment["PETSC_OPTIONS_YAML"])], "in PETSC_OPTIONS_YAML")
    reader.take(line, COMMAND_LINE)
    return reader.given()


class _Reader:
    """Reads place after place: each for itself to know what it sets, then all of them into one database."""

    def __init__(self):
        self._places, self._files, self._steps, self._read = [], [], [], 0

    def take(self, pairs, description):
        """Take the option files and then the options of some words."""
        own, whole = [], any(name.lower() == "-prefix_push" for name, _ in pairs)
        for name, text in pairs:
            if name.lower() in OPTION_FILES:
                if text is None:
                    raise InputError(f"{name}: a file name must follow")
                text = option_file(text)
                if not whole:
                    self._words(own, description)
                    own = []
                self._file(name, text, ())
            else:
                if name.lower() == "-options_string_yaml":
                    look_over_yaml(text or "", description)
                own.append((name, text, description))
            self._steps.append((name, text, description))
        self._words(own, description)

    def _words(self, own, description):
        """Take words that stand together."""
        if own:
            self._places.append(Place(description, _read(own)))

    def _file(self, flag, path, inside):
        """Take an option file, after those it includes."""
        path = os.path.expandvars(path)
        looked = look_into(flag, path, inside)
        self._read += 1
        if self._read > MOST_FILES:
            raise InputError(
                f"option file {path}: more than {MOST_FILES} files are included; allowed: {MOST_FILES}"
            )
        before = len(self._places)
        for inner_flag, inner in looked.nested:
            self._file(inner_flag, inner, (*inside, looked.identity))
        included = set().union(*(place.names for place in self._places[before:]))
        texts = _read([(flag, path, "")])
        own = {name: text for name, text in texts.items() if name not in included - looked.mentioned}
        place = Place(f"in {path}", own, path)
        _refuse_what_is_too_late(place)
        self._places.append(place)
        self._files.append(looked.identity)

    def given(self):
        """Return what was found."""
        texts = _read(self._steps)
        of_petsc = {name: text for name, text in texts.items() if _OF_PETSC.fullmatch(name)}
        for name, text in of_petsc.items():
            _check_end(name, text)
        return Given(
            texts={name: text for name, text in texts.items() if name not in of_petsc},
            places=self._places,
            files=self._files,
            of_petsc=of_petsc,
            warnings=list(self._overridden()),
        )

    def _overridden(self):
        """Complaints about what a file takes back that stands before it on the command line."""
        for at, place in enumerate(self._places):
            later = self._places[at + 1 :]
            for name in sorted(place.names) if place.description == COMMAND_LINE else ():
                last = next((other for other in reversed(later) if name in other.names), None)
                if last and last.file and last.texts[name] != place.texts[name]:
                    before, after = quoted(place.texts[name]), quoted(last.texts[name])
                    yield f"-{name} {before}: {last.file} comes later and says {after}"


def _read(steps):
    """Let PETSc read options and option files, (name, text, where it stands); name -> text of what it has then."""
    from petsc4py import PETSc

    from app.petsc import OptionDatabase, error_message

    database = OptionDatabase()
    for name, text, where in steps:
        try:
            if name.lower() in OPTION_FILES:
                database.insert(f'{name} "{text}"')
            elif name.lower() == "-options_string_yaml":
                database.insert_yaml(text or "")
            elif name.lower() in ("-prefix_push", "-prefix_pop"):
                database.insert(f"{name} {text or ''}")
            else:
                database.set(name.removeprefix("-"), text or "")
        except PETSc.Error as error:
            place = f"option file {text}" if name.lower() in OPTION_FILES else where
            raise InputError(f"{place}: {error_message(error)}") from None
    found = {name.lower(): text for name, text in database.unasked().items()}
    with database.active() as options:
        if options.hasName("help"):  # which PETSc counts as asked for at once
            found["help"] = ""
    return found


def _refuse_what_is_too_late(place):
    for name in sorted(place.names):
        if _OF_PETSC.fullmatch(name) and not _LATER.fullmatch(name):
            raise InputError(
                f"-{name} {place.description}: PETSc needs it when it starts, before files are read; "
                "give it on the command line or in PETSC_OPTIONS"
            )


def _check_end(name, text):
    """Refuse what PETSc looks at when all is done, only to fail then: places for what it writes, and yes or no."""
    if name == "log_view":
        for one in re.split(",(?=:)", text or ""):
            check_viewer(name, one)
    elif name in _FILES:
        check_place(name, text, text or "")
    elif name in _YES_OR_NO:
        OptionReader([Option(name, flag, False, "")], {name: text})[name]


def _start_files(environment):
    """Paths of the option files that PETSc reads unasked."""
    home = environment.get("HOME")
    paths = [Path(home, ".petscrc")] if home else []
    return [str(path) for path in (*paths, Path(".petscrc"), Path("petscrc")) if os.path.isfile(path)]  # noqa: PTH113


def _environment_pairs(environment):
    try:
        return _pairs(shlex.split(environment.get("PETSC_OPTIONS", "")))
    except ValueError as error:
        raise InputError(f"PETSC_OPTIONS: {error}") from None


def _pairs(words):
    """Options with their dash, and their texts or None."""
    pairs, open_for_a_value = [], False
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise InputError(f"{word!a}: is not UTF-8 text") from None
        if re.match(r"-{0,2}[A-Za-z]\w*=", word) and (is_option(word) or not open_for_a_value):
            name, text = word.split("=", 1)
            raise InputError(f"{quoted(word)}: needed: -{name.lstrip('-')} {quoted(text)}")
        if is_option(word):
            pairs.append((word, None))
            open_for_a_value = word.lower() != "-prefix_pop"
        elif open_for_a_value:
            pairs[-1] = (pairs[-1][0], word)
            open_for_a_value = False
        else:
            raise InputError(f"{quoted(word)}: neither an option nor the value of one")
    return pairs
