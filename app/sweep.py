"""Run app.solve for every combination of option values: ``python -m app.sweep SWEEP.yml -o out.csv``.

A sweep is a YAML file; names and values are those of the command line, files are relative to where it is called::

    option_files:                       # in this order; a list in the list gives alternatives
      - petsc_options/punch.opts
      - [petsc_options/fmg_v11.opts, petsc_options/fmg_v10.opts]
    options:                            # a value, or a list: every combination of all lists is run
      grid: [32, 64, 128]
      lcp_rtol: 1e-8
    zip:                                # groups whose lists, equally long, are gone through together
      - approach: [-0.11, 0.01, 0.25]
        surface_seed: [1, 2, ~]         # ~ leaves the option out
    exclude:                            # left out: combinations that match all values of an entry
      - {grid: 128, approach: [0.01, 0.25]}

Each combination is a process of its own (under mpiexec with ``--ranks`` above 1) and a row of the table, also if
the program refuses it, diverges or crashes: then `exit_status` and `message` say so. The result files give
`worst_negative_gap` [mm], `worst_negative_pressure` [N/mm2] and `complementarity`, max |p e| / (max p max |h|).
What is finished is kept in ``out.runs.jsonl`` beside the table; ``--resume`` goes on from there, as far as options,
the files they name, and the program are the same.

Exit status: 0 table complete, whatever its rows say; 2 bad input, before any run; 130 interrupted, with a table of
what is finished.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import inspect
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from tqdm import tqdm

from app.output.result import read_result
from app.output.table import text, write_table

ATTRIBUTES = (
    "converged",
    "active_set_iterations",
    "inner_iterations",
    "work_units",
    "operator_applications",
    "residual",
    "load",
    "approach",
    "max_pressure",
    "contact_fraction",
    "solve_seconds",
)
CHECKS = ("worst_negative_gap", "worst_negative_pressure", "complementarity")
OUTCOME = ("exit_status", "message", *ATTRIBUTES, *CHECKS)
SUFFIXES = (".csv", ".md", ".txt", ".h5", ".hdf5")
LEFT_OUT = "~"
_SHOWN = (
    "active_set_iterations",
    "inner_iterations",
    "work_units",
    "residual",
    "contact_fraction",
    "solve_seconds",
)
REASONED = (0, 2, 3)  # exit statuses of app.solve; any other is a crash, and worth another try

_ROOT = Path(__file__).resolve().parents[1]
# What the outcome of a run depends on.
_PROGRAM = (
    "app/solve.py", "app/commands", "app/options.py", "app/contact", "app/halfspace", "app/multigrid",
    "app/problems", "petsc_options/fast.opts",
)  # fmt: skip
# Ranks of several runs must not be bound to the same cores; a run without mpiexec needs no daemon of its own.
_OPEN_MPI = {"OMPI_MCA_hwloc_base_binding_policy": "none", "OMPI_MCA_ess_singleton_isolated": "1"}
_KEYS = ("description", "option_files", "options", "zip", "exclude")
_RESERVED = {
    "output": "each run has its own",
    "options_file": "use option_files",
    "help": "it solves nothing",
}


class InputError(Exception):
    """The sweep or the command line is wrong; the message says what, where and what is allowed."""


# -- one run -----------------------------------------------------------------------------------------------


def collect_result(path):
    """Numbers of a result file for a row of the table: `ATTRIBUTES`, `CHECKS` and `reason`, name -> value."""
    result = read_result(path)
    admissible = ~np.isnan(result.undeformed_distance)
    p, e, h = (field[admissible] for field in (result.pressure, result.gap, result.undeformed_distance))
    scale = p.max(initial=0.0) * np.abs(h).max(initial=0.0)
    product = np.abs(p * e).max(initial=0.0)
    return {
        **{name: result.attributes[name] for name in (*ATTRIBUTES, "reason")},
        "worst_negative_gap": float(e.min(initial=0.0)),
        "worst_negative_pressure": float(result.pressure.min(initial=0.0)),
        "complementarity": float(product / scale) if scale != 0 else 0.0,  # NaN stays NaN
    }


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

    def key(self, ranks=1):
        """Return a digest of all that the outcome depends on: options, files, program, number of ranks."""
        gap_file = str(self.options.get("gap_file", "")).partition(":/")[0]
        contents = [_digest(Path(file)) for file in (*self.files, gap_file) if Path(file).is_file()]
        module = _ROOT.joinpath(*self.module.split(".")).with_suffix(".py")
        program = [_program_digest(), _digest(module), inspect.getsource(self.collect)]
        what = [self.module, self.arguments(), contents, ranks, program, os.environ.get("PETSC_OPTIONS")]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def _digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _program_digest():
    parts = [_ROOT / name for name in _PROGRAM]
    sources = [source for part in parts for source in (sorted(part.rglob("*.py")) or [part])]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


class Processes:
    """Starts processes from several threads, and ends them all at once."""

    def __init__(self):
        self._running, self._lock, self._closed = set(), threading.Lock(), False

    def call(self, command, timeout=None):
        """Run a command in a process group of its own, so that Ctrl-C reaches only the caller.

        Returns
        -------
        status : int
            Exit status; minus the signal that ended it.
        errors : str
            What it said on standard error.

        Raises
        ------
        subprocess.TimeoutExpired
            After `timeout` seconds; the process is gone then.
        """
        environment = {"OMP_NUM_THREADS": "1", **os.environ, **_OPEN_MPI}
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(_ROOT), os.environ.get("PYTHONPATH")]))
        # A file, not a pipe: a daemon that outlives the process would keep a pipe open.
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            with self._lock:
                if self._closed:
                    raise InterruptedError("no more processes are started")
                process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors,
                    env=environment, start_new_session=True,
                )  # fmt: skip
                self._running.add(process)
            try:
                process.wait(timeout)
            except subprocess.TimeoutExpired:
                _end(process)
                raise
            finally:
                with self._lock:
                    self._running.discard(process)
            errors.seek(0)
            return process.returncode, errors.read()

    def close(self):
        """End all processes and start no more."""
        with self._lock:
            self._closed = True
            running = list(self._running)
        for process in running:
            _end(process)


def _end(process):
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(3)
            return
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def perform(run, output, processes, ranks=1, timeout=None):
    """Call the program of a run and collect its outcome.

    Not collective; call from any thread.

    Parameters
    ----------
    run : Run
    output : Path
        File the program is to write.
    processes : Processes
    ranks : int
    timeout : float, optional
        [s]

    Returns
    -------
    dict
        `exit_status`, `message` (empty, warnings, or what went wrong), and what ``run.collect`` returns.
    """
    command = [sys.executable, "-m", run.module, *run.arguments(), "-output", str(output)]
    if ranks > 1:
        command = ["mpiexec", "-n", str(ranks), *command]
    output.unlink(missing_ok=True)
    try:
        status, errors = processes.call(command, timeout)
    except subprocess.TimeoutExpired:
        return {"exit_status": 124, "message": f"stopped after {timeout:g} s"}
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    outcome = {"exit_status": status, "message": " ".join(x for x in lines if x.startswith("warning: "))}
    if status in (0, 3) and output.is_file():
        try:
            outcome |= run.collect(output)
        except (ValueError, OSError) as error:
            outcome["message"] = str(error)
        if status == 3:
            why = outcome.get("reason") or "not converged"
            outcome["message"] = ". ".join(filter(None, (why, outcome["message"])))
    else:
        told = [line for line in lines if line.startswith("error: ")] or lines or ["no result file"]
        outcome["message"] = told[-1] if status >= 0 else f"ended by {signal.Signals(-status).name}"
    return outcome


# -- many runs ---------------------------------------------------------------------------------------------


class Journal:
    """Outcomes of finished runs in a file of JSON lines, so that an interrupted sweep can go on.

    Parameters
    ----------
    path : Path
    resume : bool
        Keep what is there already; else start anew.

    Raises
    ------
    InputError
        If another process is writing it.
    """

    def __init__(self, path, resume=False):
        try:
            self._file = path.open("a+", encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InputError(f"{path}: another process is writing it") from None
        self.outcomes = {}
        if not resume:
            self._file.truncate(0)
        self._file.seek(0)
        for line in self._file:
            try:
                entry = json.loads(line)
            except ValueError:  # cut off when the process was killed
                continue
            self.outcomes[entry.pop("key")] = entry
        self._file.write("\n")  # ends a line that was cut off

    def add(self, key, outcome):
        """Record an outcome; it is on its way to the disk when this returns."""
        self.outcomes[key] = outcome
        json.dump({"key": key, **outcome}, self._file, default=_plain)
        self._file.write("\n")
        self._file.flush()

    def close(self):
        """Close the file and let others write it."""
        self._file.close()


def _plain(value):
    return value.tolist()  # numpy scalars and arrays


def run_all(runs, folder, journal, *, jobs=1, ranks=1, keep=False, timeout=None, description="runs"):
    """Perform runs, several at a time; those that are in the journal count as done.

    Parameters
    ----------
    runs : sequence of Run
        Equal ones are performed once.
    folder : Path
        Where their files are written.
    journal : Journal
    jobs, ranks : int
        Runs at a time, and ranks of each.
    keep : bool
        Keep the files; runs whose file is missing are performed again.
    timeout : float, optional
        For each run [s].
    description : str
        In front of the progress bar.

    Returns
    -------
    list of dict or None
        Outcome of each run (see `perform`), with the path of its file as `result` if it is kept; None if an
        interrupt (Ctrl-C) left it undone.
    bool
        Whether there was an interrupt.
    """
    keys = [run.key(ranks) for run in runs]
    files = {key: folder / f"{key}.h5" for key in keys}
    todo = {}
    for key, run in zip(keys, runs, strict=True):
        status = journal.outcomes.get(key, {}).get("exit_status")
        if status not in REASONED or (keep and status != 2 and not files[key].is_file()):
            journal.outcomes.pop(key, None)
            todo[key] = run
    folder.mkdir(exist_ok=True)
    processes = Processes()
    interrupted = False
    failed = 0

    def work(key, run):
        try:
            return perform(run, files[key], processes, ranks, timeout)
        finally:
            if not keep:
                files[key].unlink(missing_ok=True)

    total = len(files)
    bar = tqdm(total=total, initial=total - len(todo), desc=description, unit="run", disable=None)
    with bar, ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(work, key, run): key for key, run in todo.items()}
        try:
            for future in as_completed(futures):
                outcome = future.result()
                journal.add(futures[future], outcome)
                failed += outcome["exit_status"] != 0
                bar.set_postfix_str(f"{failed} failed" if failed else "", refresh=False)
                bar.update()
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            processes.close()
            interrupted = isinstance(error, KeyboardInterrupt)
            if not interrupted:
                raise
    if not any(folder.iterdir()):
        folder.rmdir()

    def told(key):
        outcome = journal.outcomes.get(key)
        kept = {"result": str(files[key])} if keep and files[key].is_file() else {}
        return outcome and {**outcome, **kept}

    return [told(key) for key in keys], interrupted


# -- the sweep file ----------------------------------------------------------------------------------------


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
        content = yaml.load(Path(path).read_text(encoding="utf-8"), _Loader)
        return _combine(content)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"sweep {path}: {getattr(error, 'strerror', None) or error}") from None
    except (yaml.YAMLError, InputError) as error:
        raise InputError(f"sweep {path}: {error}") from None


def _combine(content):
    _mapping(content, "the file", _KEYS)
    axes = []  # each a list of alternatives: ({column: label}, [files], {option: text})
    files = _sequence(content.get("option_files") or [], "option_files")
    for entry in files:
        names = [_scalar(name, "option_files") for name in _listed(entry, "option_files")]
        for name in names:
            if not Path(name).is_file():
                raise InputError(f"option_files: {name}: no such file")
        label = len(names) > 1
        axes.append([({"option_files": Path(name).stem} if label else {}, [name], {}) for name in names])
    seen = set()
    options = _mapping(content.get("options") or {}, "options")
    for name, values in options.items():
        values = _values(name, values, seen)
        axes.append([_setting({name: value}, len(values) > 1) for value in values])
    for group in _sequence(content.get("zip") or [], "zip"):
        lists = {name: _values(name, values, seen) for name, values in _mapping(group, "zip").items()}
        lengths = {name: len(values) for name, values in lists.items()}
        if len(set(lengths.values())) != 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items()) or "nothing"
            raise InputError(f"zip: lists of a group must be equally long; these have: {told}")
        together = zip(*lists.values(), strict=True)
        axes.append([_setting(dict(zip(lists, values, strict=True)), True) for values in together])
    if not seen and not files:
        raise InputError("neither option_files nor options are given")
    excluded = []
    for entry in _sequence(content.get("exclude") or [], "exclude"):
        for name in _mapping(entry, "exclude"):
            if name not in seen:
                raise InputError(f"exclude: {name} is not among the options")
        excluded.append({name: _listed(values, f"exclude, {name}") for name, values in entry.items()})
        if not entry:
            raise InputError("exclude: an entry must name an option")
    runs = [_merge(combination) for combination in itertools.product(*axes)]
    runs = [run for run in runs if not any(_matches(run, entry) for entry in excluded)]
    if not runs:
        raise InputError("exclude leaves no combination")
    return runs


def _setting(options, label):
    given = {name: value for name, value in options.items() if value != LEFT_OUT}
    labels = {name: _number(given.get(name)) for name in options} if label else {}
    return labels, [], given


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
    """Return the value, or the values of a list, as a list."""
    values = value if isinstance(value, list) else [value]
    if not values:
        raise InputError(f"{where}: the list is empty")
    return [_scalar(item, where) for item in values]


def _scalar(value, where):
    if not isinstance(value, str):
        raise InputError(f"{where}: {json.dumps(value)}: must be a number or text")
    return value


def _values(name, values, seen):
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        raise InputError(f"option {name}: a name without dash and blanks is needed")
    if name in _RESERVED:
        raise InputError(f"option {name}: not allowed in a sweep, {_RESERVED[name]}")
    if name in seen:
        raise InputError(f"option {name}: is given twice")
    seen.add(name)
    return _listed(values, f"option {name}")


def _number(value):
    """Return the text as a number if it is one."""
    for kind in (int, float):
        try:
            return kind(value)
        except (TypeError, ValueError):
            continue
    return value


# -- the table and the command -----------------------------------------------------------------------------


def rows_of(runs, outcomes):
    """Rows of the table: labels and outcome of every run that is done.

    A column of the outcome that has the name of a varied option is called ``result_NAME``.
    """
    taken = {name for run in runs for name in run.labels}
    columns = {name: f"result_{name}" if name in taken else name for name in (*OUTCOME, "result")}
    return [
        {**run.labels, **{column: outcome.get(name) for name, column in columns.items()}}
        for run, outcome in zip(runs, outcomes, strict=True)
        if outcome is not None
    ]


class Parser(argparse.ArgumentParser):
    """Complains like everything else."""

    def error(self, message):
        """Raise InputError."""
        raise InputError(message)


def count(text):
    """Kind of a command line argument: a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: not allowed; allowed: a whole number of at least 1")
    return int(text)


def seconds(text):
    """Kind of a command line argument: a positive number."""
    value = _number(text)
    if isinstance(value, str) or not 0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"{text}: not allowed; allowed: a positive number")
    return value


def check_ranks(ranks):
    """Refuse several ranks where there is no mpiexec."""
    if ranks > 1 and not shutil.which("mpiexec"):
        raise InputError(f"--ranks {ranks}: there is no mpiexec on PATH")


def _check_output(path):
    if path.suffix not in SUFFIXES:
        raise InputError(f"-o {path}: the name must end in one of {', '.join(SUFFIXES)}")
    if path.exists() and not path.is_file():
        raise InputError(f"-o {path}: exists and is not a regular file")
    if not path.parent.is_dir():
        raise InputError(f"-o {path}: folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"-o {path}: cannot write in {path.parent}")


def interruptible(main, argv=None):
    """Call a command's ``main(argv)`` so that SIGTERM ends it like Ctrl-C; return its exit status."""
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return main(argv)
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    finally:
        signal.signal(signal.SIGTERM, previous)


def main(argv=None):
    """Run the command and return its exit status."""
    return interruptible(_main, argv)


def _main(argv):
    parser = Parser(
        prog="python -m app.sweep", description="Run app.solve for every combination of option values."
    )
    parser.add_argument(
        "sweep", type=Path, metavar="SWEEP.yml", help="what to vary; see petsc_options/sweeps/"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="TABLE", help=f"table: {' '.join(SUFFIXES)}"
    )
    parser.add_argument("--jobs", type=count, default=1, metavar="N", help="runs at a time; default: 1")
    parser.add_argument(
        "--ranks", type=count, default=1, metavar="P", help="MPI ranks of each run; default: 1"
    )
    parser.add_argument("--timeout", type=seconds, metavar="S", help="stop a run after S seconds")
    parser.add_argument("--resume", action="store_true", help="keep what an earlier call has finished")
    parser.add_argument("--keep", action="store_true", help="keep the result files, in TABLE.runs/")
    arguments = parser.parse_args(argv)
    output = arguments.output
    check_ranks(arguments.ranks)
    _check_output(output)
    runs = read_sweep(arguments.sweep)
    journal = Journal(output.with_suffix(".runs.jsonl"), arguments.resume)
    try:
        outcomes, interrupted = run_all(
            runs, output.with_suffix(".runs"), journal, jobs=arguments.jobs, ranks=arguments.ranks,
            keep=arguments.keep, timeout=arguments.timeout, description=arguments.sweep.stem,
        )  # fmt: skip
    finally:
        journal.close()
    rows = rows_of(runs, outcomes)
    varied = dict.fromkeys(name for run in runs for name in run.labels)
    columns = [name for name in rows[0] if name != "result" or arguments.keep] if rows else list(varied)
    write_table(output, rows, columns)
    shown = [*varied, "exit_status", *_SHOWN]
    print(text(rows, shown, {name: ".4g" for name in _SHOWN}), end="")
    for row in rows:
        if row["message"]:
            which = ", ".join(f"{name} {row[name]}" for name in varied if row[name] is not None)
            print(f"{which}: {row['message']}" if which else row["message"])
    print(f"{len(rows)} of {len(runs)} runs in {output}")
    return 130 if interrupted else 0


if __name__ == "__main__":
    sys.exit(main())
