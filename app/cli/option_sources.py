"""Sources of options; later ones override earlier ones.

1. ``~/.petscrc``, ``.petscrc``, ``petscrc``, unless ``-skip_petscrc`` is on the command line; ``PETSC_OPTIONS``. PETSc
   reads them at its start.
2. The command line, with option files where they are named. As in PETSc, a file overrides options before it on the
   command line; a warning names the overridden options.

Only rank 0 reads the files, by PETSc, and broadcasts the options.
"""

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from app.base.errors import InputError, format_yaml_error, shorten
from app.options.option_table import (
    FILES,
    Option,
    OptionReader,
    find_option_file,
    flag,
    is_off,
)
from app.options.viewers import check_output, check_viewer

COMMAND_LINE = "on the command line"
PETSC_START = "in PETSC_OPTIONS or .petscrc"
MAX_FILES = 100  # included option files; a file counts as often as it is included
MAX_FILE_BYTES = 1 << 24
_MAX_YAML_NODES = 10_000  # a node counts as often as aliases repeat it
_FILE_FLAGS = ("-options_file", "-options_file_yaml")
# PETSc reads these at its end, all other options of its own at its start.
_READ_AT_END = (
    "help log_view options_left options_view memory_view objects_dump citations mpidump get_total_flops process_view "
    "debugger_pause nox tmp shared_tmp"
).split()
_OUTPUT_FILES = ("citations", "history", "log_summary", "malloc_view")
_FLAGS = ("options_view", "options_left", "get_total_flops", "mpidump")
_OPTION_IN_FILE = re.compile(r"^[ \t]*--?(\w+)(?:[ \t]+\"?([^\s\"]+))?", re.MULTILINE)
_CONTROL_CHARACTER = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass(frozen=True)
class OptionSource:
    """Options of one file, or of the command line between two files."""

    where: str  # in messages
    texts: dict  # name, without dash and in lower case -> text
    file: str = ""


@dataclass
class ParsedOptions:
    """All options of a command, with their sources."""

    texts: dict  # name -> text of the last source that sets it, without `petsc_options`
    sources: list = field(default_factory=list)
    files: list = field(default_factory=list)
    petsc_options: dict = field(default_factory=dict)  # of no solver, such as ``-log_view``
    database_options: dict = field(default_factory=dict)  # `petsc_options` and the command line

    def select_alternative(self, alternatives, needed=""):
        """Return the exclusive option that applies; remove overridden ones.

        `alternatives` are names of options, or tuples of names that are allowed together. The alternative on the
        command line applies. Otherwise the alternative in the last option file that has one applies. Return None if no
        alternative is given; but if one must be given, `needed` names the alternatives for the error message. Raises
        InputError if the source that applies has several alternatives.
        """
        members = {one: (one,) if isinstance(one, str) else one for one in alternatives}
        present = [one for one in alternatives if self.texts.keys() & members[one]]
        if not present:
            if needed:
                raise InputError(f"neither {needed} is given: exactly one is needed")
            return None
        by_source = {}  # in order; all parts of the command line are one source
        for source in self.sources:
            if ones := {one for one in present if source.texts.keys() & set(members[one])}:
                by_source[source.where] = ones | by_source.pop(source.where, set())
        where = COMMAND_LINE if COMMAND_LINE in by_source else next(reversed(by_source), "")
        selected, *others = (one for one in present if one in by_source.get(where, present))
        if others:
            names = [next(name for name in members[one] if name in self.texts) for one in (selected, *others)]
            both = "both " if len(names) == 2 else ""
            names = " and ".join(f"-{name}" for name in names)
            raise InputError(f"{both}{names} are given {where}".rstrip() + ": exactly one is allowed")
        for one in present:
            for name in members[one] if one != selected else ():
                self.texts.pop(name, None)
        return selected

    def split_by_source(self, names):
        """Return the options from each file, and from the command line.

        Only options with the given `names` are returned. The first result maps each option file, in order, to its
        options. The second result has the options that the command line sets last.
        """
        files, last = {}, {}
        for source in self.sources:
            texts = {name: text for name, text in source.texts.items() if name in names & self.texts.keys()}
            last |= dict.fromkeys(texts, source.where)
            if source.file and texts:
                files[source.file] = files.pop(source.file, {}) | texts
        return files, {name: self.texts[name] for name in sorted(last) if last[name] == COMMAND_LINE}

    def explicit_names(self):
        """Return the names of options that the command line or files set.

        Options set only by PETSC_OPTIONS or .petscrc are left out, because they may be meant for other programs.
        """
        explicit = {name for source in self.sources if source.where != PETSC_START for name in source.texts}
        implicit = {name for source in self.sources for name in source.texts} - explicit
        return self.texts.keys() - implicit

    def overridden(self):
        """Yield a warning for each option that files override."""
        for at, source in enumerate(self.sources):
            for name in sorted(source.texts) if source.where == COMMAND_LINE else ():
                last = next(later for later in reversed(self.sources[at:]) if name in later.texts)
                before, after = source.texts[name], last.texts[name]
                if last.file and after != before:
                    yield f"-{name} {shorten(before)}: {last.file} comes later and says {shorten(after)}"


def startup_args(argv):
    """Return the command line's words for PETSc's start.

    Option files and -help are left out, because they are handled later. Raises InputError for a word that is neither an
    option nor the value of an option.
    """
    words = argv[:1]
    for name, text in _parse_words(argv[1:]):
        if name in ("prefix_push", "prefix_pop"):
            raise InputError(f"-{name}: only in option files; write whole names on the command line")
        _check_fp_trap({name: text or ""})
        if f"-{name}" not in _FILE_FLAGS and name != "help":
            words += [f"-{name}"] if text is None else [f"-{name}", text]
    return words


def parse_options(argv):
    """Read all sources of options, after PETSc has started.

    `argv` begins with the name of the program. Raises InputError if a source cannot be read; the message names it.
    """
    from petsc4py import PETSc

    from app.options.solver_options import is_used, options_with_prefix

    words, database = _parse_words(argv[1:]), options_with_prefix("")
    typed = {name for name, _ in words}
    at_start = {name: text for name, text in database.items() if name not in typed}
    sources, files = [OptionSource(PETSC_START, at_start)], []
    for name, text in words:
        if f"-{name}" in _FILE_FLAGS:
            if text is None:
                raise InputError(f"-{name}: a file name must follow")
            _read_file(f"-{name}", find_option_file(text), (), sources, files)
            continue
        if sources[-1].where != COMMAND_LINE:
            sources.append(OptionSource(COMMAND_LINE, {}))
        sources[-1].texts[name] = text or ""
    texts = {name: text for source in sources for name, text in source.texts.items()}
    petsc_options = {name: text for name, text in texts.items() if name in _READ_AT_END or is_used(name)}
    _check_fp_trap(texts)
    try:
        _check_read_at_end(petsc_options)
    except InputError:
        for name in petsc_options:  # PETSc would report them at its end, too
            PETSc.Options().delValue(name)
        raise
    return ParsedOptions(
        texts={name: text for name, text in texts.items() if name not in petsc_options},
        sources=sources,
        files=files,
        petsc_options=petsc_options,
        database_options={
            name: text for name, text in texts.items() if name in petsc_options or name in typed
        },
    )


def _read_file(flag, path, parents, sources, files):
    """Append the options of a file and its included files to `sources`."""
    from app.options.solver_options import read_option_file

    path = os.path.expandvars(path)
    if len(files) >= MAX_FILES:
        raise InputError(f"option file {path}: at most {MAX_FILES} files may be included")
    content = _read_content(path, parents)
    identity, count = str(Path(path.removesuffix(":yaml")).resolve()), len(sources)
    files.append(identity)
    names = set()
    suffixes = (":yaml", ".yaml", ".yml", ".json")
    is_yaml = flag == _FILE_FLAGS[1] or path.endswith(suffixes) or content.startswith(("---", "%YAML "))
    if is_yaml:
        _check_yaml(content, f"option file {path}")
        included = [(_FILE_FLAGS[1], file) for file in re.findall(r"!include\s+(\S+)", content)]
    else:
        content = re.sub("#.*", "", content)
        for number, line in enumerate(content.split("\n"), 1):
            if line.count('"') % 2:  # PETSc would read on after the line
                line = shorten(line.strip())
                raise InputError(f"option file {path}, line {number}: {line}: a quote is not closed")
        options = [(name.lower(), text) for name, text in _OPTION_IN_FILE.findall(content)]
        names = {name for name, _ in options}
        included = [(f"-{name}", file) for name, file in options if f"-{name}" in _FILE_FLAGS and file]
    for inner_flag, inner in included:
        _read_file(inner_flag, inner, (*parents, identity), sources, files)
    inherited = {name for source in sources[count:] for name in source.texts} - names
    texts = read_option_file(path, _FILE_FLAGS[is_yaml])
    texts = {name: text for name, text in texts.items() if is_yaml or name not in inherited}
    sources.append(OptionSource(f"in {path}", texts, path))


def _read_content(path, parents):
    """Return the text of an option file.

    `parents` are the option files that lead to this file: each one includes the next one, and the last one includes
    this file.
    """
    where = f"option file {path}" + (f" (included by {parents[-1]})" if parents else "")
    file = Path(path.removesuffix(":yaml"))
    try:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise InputError(f"{where}: is not a regular file")
        if file.is_file() and file.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{where}: is larger than {MAX_FILE_BYTES >> 20} MiB")
        content = file.read_bytes().decode()
        if str(file.resolve()) in parents:
            raise InputError(f"option file {path}: includes itself (included by {parents[-1]})")
    except (OSError, RuntimeError) as error:
        own = sorted(path.stem for path in FILES.glob("*.opts"))
        hint = f"; the program's own: {', '.join(own)}" if isinstance(error, FileNotFoundError) else ""
        raise InputError(f"{where}: {getattr(error, 'strerror', None) or error}{hint}") from None
    except UnicodeDecodeError:
        content = "\0"
    if _CONTROL_CHARACTER.search(content):
        raise InputError(f"{where}: is not a text file")
    return content


def _check_yaml(content, where):
    """Raise InputError for wrong YAML, or for aliases that expand too much."""
    import yaml

    try:
        nodes = list(yaml.compose_all(content, getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{where}{format_yaml_error(error, content)}") from None
    count = 0
    while nodes:
        node = nodes.pop()
        if (count := count + 1) > _MAX_YAML_NODES:
            raise InputError(f"{where}: expands to more than {_MAX_YAML_NODES} nodes")
        if not isinstance(node, yaml.ScalarNode):
            nodes += [one for part in node.value for one in (part if isinstance(part, tuple) else (part,))]


def _check_fp_trap(texts):
    if "fp_trap" in texts and not is_off(texts["fp_trap"]):
        raise InputError("-fp_trap: not available; holes of a body are NaN, with which numpy computes")


def _check_read_at_end(petsc_options):
    """Raise InputError for options that would make PETSc fail at its end."""
    for viewer in re.split(",(?=:)", petsc_options.get("log_view", "")):
        check_viewer("log_view", viewer)
    for name in petsc_options.keys() & set(_OUTPUT_FILES):
        check_output(name, petsc_options[name], petsc_options[name])
    for name in petsc_options.keys() & set(_FLAGS):
        OptionReader([Option(name, flag, False, "")], petsc_options)[name]


def _parse_words(words):
    """Return pairs of option name (without dash) and text.

    The text is None if the option has no value.
    """
    pairs, needs_value = [], False
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            raise InputError(f"{word!a}: is not UTF-8 text") from None
        # Like PETSc, take -inf and -nan for numbers.
        number = re.match(r"-(inf(inity)?|nan)(?![a-z0-9_])", word, re.IGNORECASE)
        is_option = re.match("--?[A-Za-z]", word) is not None and not number
        if re.match(r"-{0,2}[A-Za-z]\w*=", word) and (is_option or not needs_value):
            name, text = word.split("=", 1)
            raise InputError(f"{shorten(word)}: needed: -{name.lstrip('-')} {shorten(text)}")
        if is_option:
            pairs.append((word.removeprefix("-").lower(), None))
        elif needs_value:
            pairs[-1] = (pairs[-1][0], word)
        else:
            blank = " (is there a blank after a comma?)" if pairs and str(pairs[-1][1]).endswith(",") else ""
            raise InputError(f"{shorten(word)}: neither an option nor the value of one{blank}")
        needs_value = is_option
    return pairs
