"""Sweep files: combinations of option values, see docs/commands.md."""

import itertools
import json
import math
import re
from pathlib import Path

import yaml

from app.base.errors import InputError, format_yaml_error
from app.options.option_table import find_option_file, number
from app.parameter_study.run import Run

LEFT_OUT = "~"  # value that leaves an option out
MAX_RUNS = 100_000  # combinations before `exclude` removes some
_KEYS = ("description", "option_files", "options", "zip", "exclude")
_RESERVED = {
    "output": "each run has its own",
    "options_file": "use option_files",
    "help": "it solves nothing",
}


class _Loader(yaml.BaseLoader):
    """YAML loader that leaves values as texts and rejects duplicate keys."""

    def construct_mapping(self, node, deep=False):
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(f"line {node.start_mark.line + 1}: {key} is given twice")
        return super().construct_mapping(node, deep)


def read_sweep(path):
    """Return a `Run` for each combination of values in a sweep file.

    The values of the last list in the file vary fastest. The labels of a run are its varied options. Raises InputError
    if the file cannot be read or its contents are not allowed.
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
    """Return a `Run` for each combination of values in a sweep.

    An axis of combinations is a list of alternatives, each a tuple of labels, option files and options.
    """
    _check_mapping(content, "the file", _KEYS)
    files = _check_list(content.get("option_files") or [], "option_files")
    axes, seen = [_file_axis(entry) for entry in files], set()
    for name, values in _check_mapping(content.get("options") or {}, "options").items():
        values = _read_values(name, values, seen)
        axes.append(_option_axis({name: values}, len(values) > 1))
    for group in _check_list(content.get("zip") or [], "zip"):
        _check_mapping(group, "zip")
        lists = {name: _read_values(name, values, seen) for name, values in group.items()}
        if len({len(values) for values in lists.values()}) != 1:
            lengths = ", ".join(f"{name} {len(values)}" for name, values in lists.items()) or "nothing"
            raise InputError(f"zip: lists of a group must be equally long; these have: {lengths}")
        axes.append(_option_axis(lists, True))
    if not seen and not files:
        raise InputError("neither option_files nor options are given")
    entries = _check_list(content.get("exclude") or [], "exclude")
    excluded = [_read_exclusion(entry, seen) for entry in entries]
    if (count := math.prod(map(len, axes))) > MAX_RUNS:
        raise InputError(f"{count} combinations; at most {MAX_RUNS} are allowed")
    runs = [_merge(combination) for combination in itertools.product(*axes)]
    runs = [run for run in runs if not any(_matches(run, entry) for entry in excluded)]
    if not runs:
        raise InputError("exclude leaves no combination")
    return runs


def _file_axis(entry):
    """Return the alternatives in an entry of ``option_files``.

    The entry is an option file, or a list of alternatives.
    """
    entries = entry if isinstance(entry, list) else [entry]
    names = [find_option_file(_check_scalar(name, "option_files")) for name in entries]
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


def _option_axis(lists, label):
    """Return the axis of combinations of options varying together.

    `lists` maps each option to its list of values.
    """
    axis = []
    for values in zip(*lists.values(), strict=True):
        options = {name: value for name, value in zip(lists, values, strict=True) if value != LEFT_OUT}
        labels = {name: _parse_number(options.get(name)) for name in lists} if label else {}
        axis.append((labels, [], options))
    return axis


def _read_exclusion(entry, seen):
    """Return an entry of ``exclude`` as a mapping of options to values."""
    for name in _check_mapping(entry, "exclude"):
        if name not in seen:
            raise InputError(f"exclude: {name} is not among the options")
    if not entry:
        raise InputError("exclude: an entry must name an option")
    return {name: _list_values(values, f"exclude, {name}") for name, values in entry.items()}


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
        any(_parse_number(run.options.get(name, LEFT_OUT)) == _parse_number(value) for value in values)
        for name, values in entry.items()
    )


def _check_mapping(value, where, allowed=None):
    if not isinstance(value, dict):
        raise InputError(f"{where}: must be a mapping, name: value")
    for name in value:
        if allowed and name not in allowed:
            raise InputError(f"{where}: unknown key {name}; allowed: {', '.join(allowed)}")
    return value


def _check_list(value, where):
    if not isinstance(value, list):
        raise InputError(f"{where}: must be a list")
    return value


def _list_values(value, where):
    """Return a list as texts; an inner list becomes one text with commas."""
    values = value if isinstance(value, list) else [value]
    if not values:
        raise InputError(f"{where}: the list is empty")
    return [
        ",".join(_check_scalar(part, where) for part in item)
        if isinstance(item, list) and item
        else _check_scalar(item, where)
        for item in values
    ]


def _check_scalar(value, where):
    if not isinstance(value, str):
        raise InputError(f"{where}: {json.dumps(value)}: must be a number or text")
    return value


def _read_values(name, values, seen):
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        raise InputError(f"option {name}: a name without dash and blanks is needed")
    if name.lower() in _RESERVED:
        raise InputError(f"option {name}: not allowed in a sweep, {_RESERVED[name.lower()]}")
    if name.lower() in map(str.lower, seen):
        raise InputError(f"option {name}: is given twice")
    seen.add(name)
    return _list_values(values, f"option {name}")


def _parse_number(value):
    """Return a text's number, or the text itself if it is none."""
    for kind in (int, float):
        try:
            return number(value, kind)
        except (TypeError, ValueError):
            continue
    return value
