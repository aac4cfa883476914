"""The form of option files, looked over before PETSc reads them: what it complains of does not always name the line.

A file has one option on a line, ``-name value``; a value with blanks stands in double quotes, a comment after ``#``.
``-options_file F`` and ``-options_file_yaml F`` include others, ``alias -a -b`` gives an option another name. A file in
YAML (``.yml``, ``.yaml``, ``.json``, ``F:yaml``, or one that begins with ``---`` or ``%YAML``) has names and values,
nested names joined by ``_``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from app.errors import InputError, quoted, yaml_fault
from app.options import FILES

OPTION_FILES = ("-options_file", "-options_file_yaml")
LARGEST_FILE = 1 << 24  # bytes of an option file
_MOST_NODES = 10_000  # of YAML, each as often as aliases repeat it
_OWN = sorted(path.stem for path in FILES.glob("*.opts"))
_FORM = (
    "allowed: an option on a line, -name value, a value with blanks in double quotes, and # before a comment"
)
_YAML_FORM = "allowed: name: value, or names below it, indented; [a, b] for several values"
# A word is what stands between blanks, or in double quotes; of an open quote there is no end.
_WORD = re.compile(r'"(?P<quoted>[^"]*)(?P<end>"?)|[^ "][^ ]*')
_NO_TEXT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass
class Looked:
    """What an option file has.

    Attributes
    ----------
    identity : str
        Of the file.
    mentioned : set of str
        Options that stand in the file itself, without dash and in lower case.
    nested : list of (str, str)
        Flags and names of the files that it includes.
    """

    identity: str = ""
    mentioned: set = field(default_factory=set)
    nested: list = field(default_factory=list)


def is_option(word):
    """Whether PETSc takes a word for an option, not for a value: -inf is a number."""
    number = re.match(r"-(inf(inity)?|nan)(?![a-z0-9_])", word, re.IGNORECASE)
    return re.match("--?[A-Za-z]", word) is not None and not number


def bare(word):
    """Name of an option."""
    return word.removeprefix("-").lower()


def look_into(flag, path, inside):
    """Look over an option file. Not collective; needs no PETSc.

    Parameters
    ----------
    flag : str
        By which it is included.
    path : str
    inside : sequence of str
        Identities of the files that include it.

    Returns
    -------
    Looked

    Raises
    ------
    InputError
        If it is no option file; with the line.
    """
    by = f" (included by {inside[-1]})" if inside else ""
    file = Path(path.removesuffix(":yaml"))
    try:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise InputError(f"option file {path}{by}: is not a regular file")
        if file.is_file() and file.stat().st_size > LARGEST_FILE:
            raise InputError(f"option file {path}{by}: is larger than {LARGEST_FILE >> 20} MiB")
        content = file.read_bytes().decode()
        identity = str(file.resolve())
    except (OSError, RuntimeError) as error:
        own = f"; the program's own: {', '.join(_OWN)}" if isinstance(error, FileNotFoundError) else ""
        raise InputError(
            f"option file {path}{by}: {getattr(error, 'strerror', None) or error}{own}"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"option file {path}{by}: is not a text file") from None
    if _NO_TEXT.search(content):
        raise InputError(f"option file {path}{by}: is not a text file")
    if identity in inside:
        raise InputError(f"option file {path}: includes itself{by}")
    yaml = flag.lower() == OPTION_FILES[1] or path.endswith((":yaml", ".yaml", ".yml", ".json"))
    if content.startswith("\ufeff") and not yaml:
        raise InputError(
            f"option file {path}{by}: begins with a byte order mark, which PETSc takes for an option; "
            "save it as UTF-8 without one"
        )
    look = look_over_yaml if yaml or content.startswith(("---", "%YAML ")) else _look_over
    looked = look(content, f"option file {path}")
    looked.identity = identity
    return looked


def _look_over(content, where):
    looked = Looked()
    for number, line in enumerate(content.split("\n"), 1):
        text = re.sub("[\t\r]", " ", line.partition("#")[0])
        found = list(_WORD.finditer(text))
        words = [word[0] if word["quoted"] is None else word["quoted"] for word in found]
        if words and (wrong := _wrong_with(found, words)):
            raise InputError(f"{where}, line {number}: {quoted(line.strip())}: {wrong}; {_FORM}")
        if words and is_option(words[0]):
            looked.mentioned.add(bare(words[0]))
            if words[0].lower() in OPTION_FILES:
                looked.nested.append((words[0], words[1]))
    return looked


def _wrong_with(found, words):
    """What is wrong with the words of a line, if anything is."""
    first, needed = words[0].lower(), None
    if any(word["end"] == "" or (word["end"] is None and '"' in word[0]) for word in found):
        return "a quote is not closed, or stands inside a word"
    if first == "alias":
        return None if len(words) == 3 and all(map(is_option, words[1:])) else "needed: alias -name -other"
    if not is_option(first):
        return f"{words[0]}: is not an option"
    if re.match(r"--?[a-z]\w*=", first):
        name, _, value = words[0].lstrip("-").partition("=")
        return f"needed: -{name} {value}"
    if first in OPTION_FILES:
        needed = "a file name"
    elif first == "-prefix_push":
        needed = "a prefix"
    if needed and len(words) == 1:
        return f"{needed} must follow"
    if len(words) > 1 and is_option(words[1]):
        return f"{words[1]}: is a second option"
    return f"{words[2]}: is more than a value" if len(words) > 2 else None


def look_over_yaml(content, where):
    """Look over options in YAML. Not collective; raises InputError with `where` and the line."""
    import yaml

    looked, steps = Looked(), count()

    def look(node, prefix):
        if next(steps) > _MOST_NODES:
            refuse(node, f"stands for more than {_MOST_NODES} nodes")
        if isinstance(node, yaml.ScalarNode) and not node.value:
            return
        if not isinstance(node, yaml.MappingNode):
            refuse(node, "has no name")
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                refuse(key, "a name must be a word")
            several = value.value if isinstance(value, yaml.SequenceNode) else ()
            if key.value == "<<":
                for part in several or [value]:
                    look(part, prefix)
            elif key.value.startswith("$$"):
                if value.tag.endswith("!include"):
                    looked.nested.append((OPTION_FILES[1], value.value))
            elif isinstance(value, yaml.MappingNode):
                look(value, f"{prefix}{key.value}_")
            else:
                looked.mentioned.add(f"{prefix}{key.value}".lower())
                for part in several:
                    if isinstance(part, yaml.MappingNode) and len(part.value) < 2:
                        look(part, f"{prefix}{key.value}_")
                    elif not isinstance(part, yaml.ScalarNode):
                        refuse(part, "is not a single value")

    def refuse(node, wrong):
        lines = content.splitlines()[node.start_mark.line :]
        raise InputError(
            f"{where}, line {node.start_mark.line + 1}: {quoted(lines[0].strip())}: {wrong}; {_YAML_FORM}"
        )

    try:
        for document in yaml.compose_all(content, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            look(document, "")
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{where}{yaml_fault(error, content)}; {_YAML_FORM}") from None
    return looked
