"""Sweep files, as `app.sweep` describes them: which combinations of option values are to be run. Not collective."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path

import yaml

from app.base.errors import InputError, format_yaml_error
from app.options.option_table import find_option_file, number
from app.parameter_study.run import Run

LEFT_OUT = "~"
MOST_RUNS = 100_000  # before `exclude`
_KEYS = ("description", "option_files", "options", "zip", "exclude")
_RESERVED = {
    "output": "each run has its own",
    "options_file": "use option_files",
    "help": "it solves nothing",
}


class _Loader(yaml.BaseLoader):
    """Leaves every scalar the text it is, as on a command line, and does not overlook a key given twice."""

    def construct_mapping(self, node, deep=False):
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(f"line {node.start_mark.line + 1}: {key} is given twice")
        return super().construct_mapping(node, deep)


def read_sweep(path):
    """Read a sweep file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    list of Run
        One per combination, the last list of the file varying fastest; labels are the varied options.

    Raises
    ------
    InputError
        If it cannot be read or says something that is not allowed.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        return _combine(yaml.load(text, _Loader))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"sweep {path}: {getattr(error, 'strerror', None) or error}") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"sweep {path}{format_yaml_error(error, text)}") from None
    except InputError as error:
        raise InputError(f"sweep {path}: {error}") from None


def _combine(content):
    """Runs of all combinations of the axes, each a list of alternatives: labels, option files, options."""
    _mapping(content, "the file", _KEYS)
    files = _sequence(content.get("option_files") or [], "option_files")
    axes, seen = [_files(entry) for entry in files], set()
    for name, values in _mapping(content.get("options") or {}, "options").items():
        values = _values(name, values, seen)
        axes.append(_settings({name: values}, len(values) > 1))
    for group in _sequence(content.get("zip") or [], "zip"):
        lists = {name: _values(name, values, seen) for name, values in _mapping(group, "zip").items()}
        if len({len(values) for values in lists.values()}) != 1:
            told = ", ".join(f"{name} {len(values)}" for name, values in lists.items()) or "nothing"
            raise InputError(f"zip: lists of a group must be equally long; these have: {told}")
        axes.append(_settings(lists, True))
    if not seen and not files:
        raise InputError("neither option_files nor options are given")
    excluded = [_excluded(entry, seen) for entry in _sequence(content.get("exclude") or [], "exclude")]
    if (count := math.prod(map(len, axes))) > MOST_RUNS:
        raise InputError(f"{count} combinations; at most {MOST_RUNS} are allowed")
    runs = [_merge(combination) for combination in itertools.product(*axes)]
    runs = [run for run in runs if not any(_matches(run, entry) for entry in excluded)]
    if not runs:
        raise InputError("exclude leaves no combination")
    return runs


def _files(entry):
    """Alternatives of an option file, or of a list of them."""
    entries = entry if isinstance(entry, list) else [entry]
    names = [find_option_file(_scalar(name, "option_files")) for name in entries]
    if not names:
        raise InputError("option_files: the list is empty")
    for name in names:
        if not Path(name).is_file():
            raise InputError(f"option_files: {name}: no such file")
    if len(names) == 1:
        return [({}, names, {})]
    stems = [Path(name).stem for name in names]
    labels = [stem if stems.count(stem) == 1 else name for stem, name in zip(stems, names, strict=True)]
    return [({"option_files": label}, [name], {}) for label, name in zip(labels, names, strict=True)]


def _settings(lists, label):
    """Alternatives of some options whose values are gone through together."""
    axis = []
    for values in zip(*lists.values(), strict=True):
        given = {name: value for name, value in zip(lists, values, strict=True) if value != LEFT_OUT}
        axis.append(({name: _number(given.get(name)) for name in lists} if label else {}, [], given))
    return axis


def _excluded(entry, seen):
    """Name of an option -> values, combinations with all of which are left out."""
    for name in _mapping(entry, "exclude"):
        if name not in seen:
            raise InputError(f"exclude: {name} is not among the options")
    if not entry:
        raise InputError("exclude: an entry must name an option")
    return {name: _listed(values, f"exclude, {name}") for name, values in entry.items()}


def _merge(combination):
    labels, files, options = {}, [], {}
    for more_labels, more_files, more_options in combination:
        if "option_files" in labels and "option_files" in more_labels:
            more_labels = {"option_files": f"{labels['option_files']} {more_labels['option_files']}"}
        labels |= more_labels
        files += more_files
        options |= more_options
    return Run(tuple(files), options, labels)


def _matches(run, entry):
    return all(
        any(_number(run.options.get(name, LEFT_OUT)) == _number(value) for value in values)
        for name, values in entry.items()
    )


def _mapping(value, where, allowed=None):
    if not isinstance(value, dict):
        raise InputError(f"{where}: must be a mapping, name: value")
    for name in value:
        if allowed and name not in allowed:
            raise InputError(f"{where}: unknown key {name}; allowed: {', '.join(allowed)}")
    return value


def _sequence(value, where):
    if not isinstance(value, list):
        raise InputError(f"{where}: must be a list")
    return value


def _listed(value, where):
    """Return the value, or the values of a list, as a list; a list in the list is one value with commas."""
    values = value if isinstance(value, list) else [value]
    if not values:
        raise InputError(f"{where}: the list is empty")
    return [
        ",".join(_scalar(part, where) for part in item)
        if isinstance(item, list) and item
        else _scalar(item, where)
        for item in values
    ]


def _scalar(value, where):
    if not isinstance(value, str):
        raise InputError(f"{where}: {json.dumps(value)}: must be a number or text")
    return value


def _values(name, values, seen):
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        raise InputError(f"option {name}: a name without dash and blanks is needed")
    if name.lower() in _RESERVED:
        raise InputError(f"option {name}: not allowed in a sweep, {_RESERVED[name.lower()]}")
    if name.lower() in map(str.lower, seen):
        raise InputError(f"option {name}: is given twice")
    seen.add(name)
    return _listed(values, f"option {name}")


def _number(value):
    """Return the text as a number if it is one."""
    for kind in (int, float):
        try:
            return number(value, kind)
        except (TypeError, ValueError):
            continue
    return value
