"""One run of a parameter study: command line, inputs and collected numbers."""

import hashlib
import json
import os
import re
import stat
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from math import nan
from pathlib import Path

from app.flow.results import FLOW_NUMBERS
from app.io.contact_fields import ATTRIBUTE_NAMES
from app.io.files import hash_file
from app.io.result import read_result
from app.options.option_table import FILES, list_named_files
from app.problems.roller import NUMBERS as ROLLER_NUMBERS

ROOT = Path(__file__).resolve().parents[2]
_ANSWER = (
    "contact_fraction", "max_pressure", "mean_gap", "load", "approach", "mean_pressure", "contact_fraction_corrected",
)  # fmt: skip
_WORK = (
    "converged", "active_set_iterations", "inner_iterations", "work_units", "operator_applications", "residual",
    "solve_seconds",
)  # fmt: skip
WHERE_KNOWN = (  # columns only if a run has them
    "indentation", "contact_area", "mean_contact_pressure", "stiffness", "unloading_stiffness", "conductance_width",
    "electrical_conductance", "thermal_conductance", *FLOW_NUMBERS, "contact_patches", "largest_patch",
    "plastic_area", "plastic_fraction", "plastic_volume", "mean_plastic_depth", "persson_fraction", "rms_height",
    "rms_slope", "contact_modulus", "error_bound", "load_error", "approach_error", "max_pressure_error",
    "contact_area_error", *ROLLER_NUMBERS,
)  # fmt: skip
CHECKS = ("largest_penetration", "smallest_pressure", "complementarity")
OUTCOME = ("exit_status", *_ANSWER, *WHERE_KNOWN, *_WORK, *CHECKS, "message")


def collect_result(path):
    """Return the numbers of a result file for a table's row.

    The numbers are listed in `OUTCOME`; `reason` is added; a load path has its rows in `steps`.
    """
    result = read_result(path)
    values = result.attributes
    return {
        **{name: values[name] for name in (*_ANSWER, *_WORK, "reason")},
        **{name: value for name in (*WHERE_KNOWN, *CHECKS) if (value := values.get(name, nan)) == value},
        **({"steps": _list_steps(result.path)} if result.path else {}),
    }


def _list_steps(table):
    """Return a load path's table as rows, with the columns of `OUTCOME`."""
    table = {ATTRIBUTE_NAMES.get(name, name): column.tolist() for name, column in table.items()}
    table["converged"] = [bool(solved) for solved in table.get("converged", ())]
    names = [name for name in table if name in ("step", *OUTCOME) and len(table[name])]
    rows = zip(*(table[name] for name in names), strict=True)
    return [{name: value for name, value in zip(names, row, strict=True) if value == value} for row in rows]


@dataclass(frozen=True)
class Run:
    """Call of app.solve: its options, option files and table labels."""

    files: tuple[str, ...] = ()  # option files
    options: Mapping[str, str] = field(default_factory=dict)  # name -> text, empty without a value
    labels: Mapping[str, object] = field(default_factory=dict)  # columns that identify the run in a table

    def arguments(self):
        """Return the words of the command line, without ``-output``."""
        words = [word for file in self.files for word in ("-options_file", str(file))]
        for name, value in self.options.items():
            words += [f"-{name}", str(value)] if str(value) else [f"-{name}"]
        return words

    def inputs(self):
        """Return the files that the run may read.

        The run may read the files that its options name, PETSc's start files, and the files that these or PETSc's
        environment variables name. Some may not exist.
        """
        home = Path(os.environ.get("HOME", "."), ".petscrc")
        files = [str(home), ".petscrc", "petscrc", *self.files]
        values = [file for value in self.options.values() for file in list_named_files(str(value))]
        return [*files, *values, *_find_named_files(files, _petsc_variables())]

    def key(self, ranks=1):
        """Return a hash that identifies the run.

        The hash depends on options, contents of input files, program and number of ranks.
        """
        files = [_hash_if_file(file) for file in self.inputs()]
        facts = [_hash_program(), self.arguments(), files, ranks, _petsc_variables()]
        return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]


def _petsc_variables():
    return [os.environ.get(name, "") for name in ("PETSC_OPTIONS", "PETSC_OPTIONS_YAML")]


def _find_named_files(option_files, texts):
    """Return the existing files that option files and other texts name.

    `texts` contain options, like the environment variable PETSC_OPTIONS. Option files that are named are searched, too.
    """
    named, texts, unread = [], list(texts), list(option_files)
    while texts or unread:
        if not texts:
            with suppress(OSError, UnicodeDecodeError):
                texts.append(Path(unread.pop()).read_text(encoding="utf-8"))
            continue
        for line in texts.pop().splitlines():
            line = line.partition("#")[0]
            words = [*re.findall(r'"[^"]*"|[^\s"]+', line), line.partition(":")[2].strip()]
            words = [os.path.expandvars(word.strip("\"'[]{},")) for word in words]
            names = dict.fromkeys(name for word in words for name in list_named_files(word))
            new = [name for name in names if name not in named and os.path.isfile(name)]  # noqa: PTH113
            named += new
            if "-options_file" in line.lower() or "!include" in line:
                unread += new
    return named


def _hash_if_file(path):
    with suppress(OSError, ValueError):  # too long a name, or not readable
        state = os.stat(path)  # noqa: PTH116
        if stat.S_ISREG(state.st_mode):
            return _hash_once(path, state.st_size, state.st_mtime_ns)
    return None


@cache
def _hash_once(path, *state):
    return hash_file(path)


@cache
def _hash_program():
    sources = [*(ROOT / "app").rglob("*.py"), *FILES.glob("*.opts")]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(sources))).hexdigest()
