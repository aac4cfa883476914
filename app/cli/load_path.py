"""Load paths of app.solve: options, the journal that an interrupted one goes on from, what is shown and written."""

from __future__ import annotations

import hashlib
import re
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.base.errors import InputError, call_collectively
from app.base.quantities import unit_of
from app.cli.session import note, print_output, warn
from app.io.files import check_output_path, hash_file, remove
from app.options.option_table import Option, flag, format_options, series, word

KINDS = ("load", "mean_pressure", "approach", "mean_gap")
_UNITS = ("N", "N/mm2", "mm", "mm of a periodic patch")
OPTIONS = [
    *(
        Option(f"{kind}_path", series, None, f"first:last:n[:log] or a,b,c: one after the other [{unit}]")
        for kind, unit in zip(KINDS, _UNITS, strict=True)
    ),
    Option("path_csv", word, None, "path: table of the steps (default: beside -output)"),
    Option("path_fields", flag, False, "path: a result file for every step, beside -output"),
    Option("resume", flag, False, "path: go on after the steps that an interrupted run has finished"),
]  # fmt: skip
_NO_MATTER = ("output", "path_csv", "path_fields", "resume", "lcp_monitor")  # to what a row says
_NUMBER = re.compile(
    r"(?<![\w./-])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\w/]|\.\w)"
)  # none of those within names of files
_PLURAL = re.compile(r"(# \w+?)s\b")  # of what there are some
_SHOWN = ("load", "approach", "contact_fraction", "max_pressure")


@dataclass(frozen=True)
class PathRequest:
    """What a path is asked to do: see `OPTIONS`."""

    kind: str
    numbers: tuple
    output: Path | None
    csv: Path | None
    fields: bool
    resume: bool
    inputs: list  # files that the problem is read from
    rows_depend_on: str  # options, as they would be written on a command line

    @classmethod
    def of(cls, kind, options, given, inputs):
        """Read the options of a path; its files must not take the place of what is read.

        Not collective.

        Parameters
        ----------
        kind : str
            What is prescribed.
        options : OptionReader
        given : app.cli.option_sources.ParsedOptions
            All options, and the files that they are read from.
        inputs : list of str
            Files that the problem is read from.

        Raises
        ------
        InputError
            If one is not allowed, or asks for what there is no place for.
        """
        numbers, output, csv = tuple(options[f"{kind}_path"]), options["output"], options["path_csv"]
        fields, resume = options["path_fields"], options["resume"]
        if fields and not output:
            raise InputError(
                "-path_fields: the files of the steps lie beside that of -output, which is missing"
            )
        if resume and not (output or csv):
            raise InputError(
                "-resume: what is finished is kept beside -output or -path_csv; neither is given"
            )
        csv = csv or (output and Path(output).with_suffix(".csv"))
        kept = [*given.files, *inputs]
        if csv:
            check_output_path(csv, kept, "path table", (".csv",))
            check_output_path(
                _journal_beside(csv), kept, f"path table {csv}: file of finished steps", (".jsonl",)
            )
        depends = format_options({name: text for name, text in given.texts.items() if name not in _NO_MATTER})
        output, csv = output and Path(output), csv and Path(csv)
        request = cls(kind, numbers, output, csv, fields, resume, inputs, depends)
        if fields:
            steps = [request.of_step(step) for step in range(1, len(numbers) + 1)]
            alike = {request.output.with_name(Path(name).name) for name in kept}
            for file in {steps[-1], *alike.intersection(steps)}:  # the longest name, and that of an input
                check_output_path(file, kept)
        return request

    @property
    def journal(self):
        """File of the steps finished so far, or None."""
        return self.csv and _journal_beside(self.csv)

    def of_step(self, step):
        """Result file of a step, counted from 1."""
        return self.output.with_name(f"{self.output.stem}_{step:04d}{self.output.suffix}")


def _journal_beside(csv):
    return Path(csv).with_suffix(".path.jsonl")


def run_path(wanted, solver, stiffness, save):
    """Solve along a path.

    Collective.

    Parameters
    ----------
    wanted : PathRequest
    solver : ContactSolver
    stiffness : bool
    save : callable
        ``save(solution, file)`` writes the result of a step.

    Returns
    -------
    path : LoadPath
        With ``notes``, those of all steps.
    solution : Solution
        Of the last step.
    done : context manager
        Within it everything is written; the journal is not needed any more after it.
    """
    from tqdm import tqdm

    # Numbers are refused before a file is touched.
    path = solver.path(stiffness=stiffness, **{wanted.kind: wanted.numbers})
    book = call_collectively(solver.comm, _Book, wanted, solver)
    rows, notes = solver.comm.bcast((book.rows, book.notes))
    path.go_on_after(rows)
    if rows:
        print_output(f"{len(rows)} of {len(path)} steps are done already")
    notes = notes[: len(path) - 1]  # the last step is solved in any case
    unseen = True if solver.comm.rank else None  # None: where nobody looks
    with book.kept(len(path)):
        with tqdm(total=len(path), initial=len(rows), desc="path", unit="step", disable=unseen) as bar:
            for solution in path:
                row = path.rows[-1]
                if wanted.fields:
                    save(solution, wanted.of_step(row["step"]))
                notes.append(solution.notes)
                call_collectively(solver.comm, book.add, row, solution.notes)
                _show(row, bar, wanted.kind)
        if wanted.csv:
            call_collectively(solver.comm, path.save, wanted.csv)
    path.notes = _of_all_steps(notes)
    return path, solution, book.done(len(path))


def _of_all_steps(notes):
    """Notes of each step as notes that name the steps."""
    told = {}
    for step, lines in enumerate(notes, 1):
        kinds = [_PLURAL.sub(r"\1", _NUMBER.sub("#", line)) for line in lines]
        for k, line in enumerate(lines):  # two of a kind, of two surfaces, say, stay two
            told.setdefault((kinds[k], kinds[:k].count(kinds[k])), []).append((step, line))
    return [f"{format_steps([step for step, _ in at], len(notes))}: {_ranged(at)}" for at in told.values()]


def _ranged(at):
    """Notes (step, line) that differ in numbers only as one, with ranges in place of those, in the plural if any is."""
    columns = zip(*([found[0] for found in _NUMBER.finditer(line)] for _, line in at), strict=True)
    ends = ((min(column, key=float), max(column, key=float)) for column in columns)
    ranges = (low if float(low) == float(high) else f"{low} to {high}" for low, high in ends)
    text = max((line for _, line in at), key=lambda line: len(_NUMBER.sub("#", line)))
    return _NUMBER.sub(lambda _: next(ranges), text)


class _Book:
    """The journal of a path, on rank 0; elsewhere, and without a file, it remembers nothing."""

    def __init__(self, wanted, solver):
        from app.parameter_study.journal import Journal

        self.rows, self.notes, self._journal = [], [], None  # of the steps done before
        self._path = wanted.journal
        if solver.comm.rank or not self._path:
            return
        what = {"what": _identity(wanted, solver)}
        self._journal = Journal(self._path, wanted.resume)
        found = self._journal.outcomes
        if found and found.get("path") != what:
            self._journal.close()
            raise InputError(
                f"-resume: {self._path} is of a run with other options, files, ranks or program; "
                "without -resume the path begins anew"
            )
        while (key := str(step := len(self.rows) + 1)) in found:
            if wanted.fields and not (file := wanted.of_step(step)).is_file():
                note(f"-resume: there is no {file}; step {step} of {len(wanted.numbers)} comes first")
                break
            self.notes.append(found[key].get("notes", ()))
            self.rows.append({name: value for name, value in found[key].items() if name != "notes"})
        self._what = what
        if wanted.resume and "1" not in found:
            note(
                f"-resume: nothing to go on from: {self._path} has no steps, or went when the path was finished; "
                f"step 1 of {len(wanted.numbers)} comes first"
            )
        dropped = self._journal.discarded
        if steps := sum(key.isdigit() for key in dropped):
            advice = "; -resume goes on after them" if dropped.get("path") == what else ""
            warn(
                f"{self._path}: {steps} steps of an interrupted run go when the first one of this run is done{advice}"
            )

    def add(self, row, notes):
        if self._journal:
            if "path" not in self._journal.outcomes:
                self._journal.add("path", self._what)
            self._journal.add(str(row["step"]), {**row, "notes": notes})

    @contextmanager
    def kept(self, steps):
        """Say what an end within, before all is written, leaves."""
        try:
            yield
        except BaseException:  # Ctrl-C above all
            if self._journal and (kept := len(self._journal.outcomes) - 1) > 0:
                note(f"{kept} of {steps} steps are kept in {self._path}; -resume goes on after them")
            raise

    @contextmanager
    def done(self, steps):
        """All is written within."""
        with self.kept(steps):
            yield
        if self._journal:
            self._journal.close()
            remove(self._path)


def _identity(wanted, solver):
    """Digest of all that the table depends on."""
    from app import __version__

    files = [hash_file(name) for name in wanted.inputs if Path(name).is_file()]
    parts = (wanted.rows_depend_on, *files, wanted.kind, *wanted.numbers, solver.comm.size, __version__)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def _show(row, bar, kind):
    """Tell of a step by the bar on a terminal, else in a line: first of all what is prescribed."""
    shown = {name: f" {unit_of(name)}".removesuffix(" 1") for name in (kind, *_SHOWN)}
    numbers = ", ".join(f"{name.replace('_', ' ')} {row[name]:.6g}{unit}" for name, unit in shown.items())
    failed = "" if row["converged"] else ", NOT CONVERGED"
    if bar.disable:
        print_output(f"step {row['step']} of {bar.total}: {numbers}{failed}")
    else:
        bar.set_postfix_str(f"{numbers}{failed}", refresh=False)
        bar.update(row["step"] - bar.n)


def format_steps(steps, count):
    """Some of `count` steps, as text. Not collective.

    Examples
    --------
    >>> format_steps([1, 2, 3, 7], 8), format_steps([4], 8), format_steps([1, 2], 2), format_steps([1], 1)
    ('steps 1 to 3, 7', 'step 4', 'all steps', 'step 1')
    """
    if len(steps) == count > 1:
        return "all steps"
    ends = [k for k in range(len(steps)) if steps[k : k + 2] != [steps[k], steps[k] + 1]]
    runs = [steps[first : last + 1] for first, last in zip([0, *(k + 1 for k in ends)], ends, strict=False)]
    said = [f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs]
    return f"step{'s'[: len(steps) > 1]} {', '.join(said)}"
