"""A run, what its outcome depends on, and what is kept of its result. Not collective."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from math import nan
from pathlib import Path

import numpy as np

from app.io.contact_fields import ATTRIBUTE_NAMES
from app.io.files import hash_file
from app.io.result import read_result
from app.options.option_table import FILES, list_named_files

ROOT = Path(__file__).resolve().parents[2]
_ANSWER = (
    "contact_fraction", "max_pressure", "mean_gap", "load", "approach", "mean_pressure", "contact_fraction_corrected",
)  # fmt: skip
_WORK = (
    "converged", "active_set_iterations", "inner_iterations", "work_units", "operator_applications", "residual",
    "solve_seconds",
)  # fmt: skip
WHERE_KNOWN = (  # those of grids by nested iteration only; the stiffness if it is asked for
    "indentation", "contact_area", "mean_contact_pressure", "stiffness", "contact_patches", "largest_patch",
    "persson_fraction", "rms_height", "rms_slope", "contact_modulus", "error_bound", "load_error", "approach_error",
    "max_pressure_error", "contact_area_error",
)  # fmt: skip
CHECKS = ("largest_penetration", "smallest_pressure", "complementarity")
OUTCOME = ("exit_status", *_ANSWER, *WHERE_KNOWN, *_WORK, *CHECKS, "message")


def collect_result(path):
    """Numbers of a result file for a row: those of `OUTCOME` that it knows, and `reason`, name -> value.

    The checks are `largest_penetration` [mm], `smallest_pressure` [N/mm2] and `complementarity`,
    max |p e| / (max p max |h|): computed from the fields, whatever solver wrote them. Of a load path `steps` has what
    its table says of each.
    """
    result = read_result(path)
    admissible = ~np.isnan(result.undeformed_distance)
    p, e, h = (field[admissible] for field in (result.pressure, result.gap, result.undeformed_distance))
    scale = p.max(initial=0.0) * np.abs(h).max(initial=0.0)
    product = np.abs(p * e).max(initial=0.0)
    return {
        **{name: result.attributes[name] for name in (*_ANSWER, *_WORK, "reason")},
        **{name: value for name in WHERE_KNOWN if (value := result.attributes.get(name, nan)) == value},
        "largest_penetration": float(-e.min(initial=0.0)),
        "smallest_pressure": float(result.pressure.min(initial=0.0)),
        "complementarity": float(product / scale) if scale != 0 else 0.0,  # NaN stays NaN
        **({"steps": _steps(result.path)} if result.path else {}),
    }


def _steps(table):
    """Rows of a load path, as far as a table of runs has their columns."""
    table = {ATTRIBUTE_NAMES.get(name, name): column.tolist() for name, column in table.items()}
    table["converged"] = [bool(solved) for solved in table.get("converged", ())]
    names = [name for name in table if name in ("step", *OUTCOME) and len(table[name])]
    rows = zip(*(table[name] for name in names), strict=True)
    return [{name: value for name, value in zip(names, row, strict=True) if value == value} for row in rows]


@dataclass(frozen=True)
class Run:
    """One call of a program.

    Parameters
    ----------
    files : tuple of str
        Option files, in order.
    options : mapping of str to str
        Name (without dash) -> text; empty text for a bare option.
    labels : mapping
        What the table says about this run: column -> value.
    module : str
        Program, started by ``python -m``; writes the file that its option ``-output`` names.
    collect : callable
        Path of that file -> mapping of what to keep of it (JSON types).
    """

    files: tuple[str, ...] = ()
    options: Mapping[str, str] = field(default_factory=dict)
    labels: Mapping[str, object] = field(default_factory=dict)
    module: str = "app.solve"
    collect: Callable = collect_result

    def arguments(self):
        """Return the command line, without ``-output``."""
        words = [word for file in self.files for word in ("-options_file", str(file))]
        for name, value in self.options.items():
            words += [f"-{name}", str(value)] if str(value) else [f"-{name}"]
        return words

    def inputs(self):
        """Return the names of its option files, and of what else may be a file; some may not exist.

        What files and variables name counts that PETSc reads unasked, too.
        """
        home = Path(os.environ.get("HOME", "."), ".petscrc")
        files = [str(home), ".petscrc", "petscrc", *self.files]
        values = [file for value in self.options.values() for file in list_named_files(str(value))]
        return [*files, *values, *_named_in(files, _environment())]

    def key(self, ranks=1):
        """Return a digest of all that the outcome depends on: options, files, program, number of ranks."""
        contents = [_digest(file) for file in self.inputs()]
        program = [self.module, self.collect.__qualname__, _program_digest()]
        what = [program, self.arguments(), contents, ranks, _environment()]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def _environment():
    return [os.environ.get(name, "") for name in ("PETSC_OPTIONS", "PETSC_OPTIONS_YAML")]


def _named_in(option_files, texts):
    """Names of files that option files, and those they include, and other texts of options may hold."""
    found, texts, unread = [], list(texts), list(option_files)
    while texts or unread:
        for line in (texts.pop() if texts else _text_of(unread.pop())).splitlines():
            line = line.partition("#")[0]
            words = [*re.findall(r'"[^"]*"|[^\s"]+', line), line.partition(":")[2].strip()]
            names = [
                name
                for word in words
                for name in list_named_files(os.path.expandvars(word.strip("\"'[]{},")))
            ]
            new = [name for name in names if name not in found and os.path.isfile(name)]  # noqa: PTH113
            found += new
            if "-options_file" in line.lower() or "!include" in line:
                unread += new
    return found


def _text_of(path):
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _digest(path):
    """Digest of a file; None if there is none of this name."""
    try:
        state = os.stat(path)  # noqa: PTH116
        return _digest_of(path, state.st_size, state.st_mtime_ns) if Path(path).is_file() else None
    except (OSError, ValueError):  # a name too long for a file, or nothing we may read
        return None


@cache
def _digest_of(path, *state):
    return hash_file(path)


@cache
def _program_digest():
    sources = [*(ROOT / "app").rglob("*.py"), *FILES.glob("*.opts")]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(sources))).hexdigest()
