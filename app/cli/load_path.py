"""Load paths of app.solve: options, checkpoint, and output of steps and notes."""

import hashlib
import re
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

from app import __version__
from app.api.summary import format_count
from app.base.errors import InputError, call_collectively
from app.base.quantities import unit_of
from app.cli.session import note, print_output, warn
from app.contact.loading_input import LOADINGS
from app.io.files import check_output_path, hash_file, remove
from app.options.option_table import (
    REQUIRED,
    Option,
    count,
    flag,
    format_options,
    lengths,
    positive,
    series,
    word,
)
from app.parameter_study.journal import Journal

OPTIONS = [
    *(
        Option(f"{name}_path", lengths(series) if loading.unit == "mm" else series, None,
            f"first:last:n[:log], numbers, or several of both, a,b,c [{loading.unit}]")
        for name, loading in LOADINGS.items()
    ),
    Option("path_csv", word, None, "path: table of the steps (default: next to -output)"),
    Option("path_fields", flag, False, "path: a result file for every step, next to -output"),
    Option("resume", flag, False, "path: continue an interrupted run after its finished steps"),
    Option("creep_times", series, REQUIRED,
        "times of a path of viscoelastic bodies [s]; prescribe one number, or a path with one each"),
    Option("wear_coefficient", positive, REQUIRED, "path of bodies that wear: wear coefficient [mm2/N]"),
    Option("sliding_distance", lengths(positive), REQUIRED, "wear: distance of all steps [mm]"),
    Option("wear_steps", count, REQUIRED, "wear: number of steps; prescribe one number, or a path with one each"),
]  # fmt: skip
_HISTORIES = {"creep_times": "creep", "wear_coefficient": "wear"}  # option -> method of ContactSolver
_OUTPUT_OPTIONS = ("output", "path_csv", "path_fields", "resume", "lcp_monitor")  # do not change rows
_NUMBER = re.compile(r"(?<![\w./-])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\w/]|\.\w)")  # not in names of files
_PLURAL = re.compile(r"(# \w+?)s\b")
_SHOWN = ("load", "approach", "contact_fraction", "max_pressure")


class PathRequest:
    """Load path from the options, with its files.

    `kind` is the name of the prescribed quantity, `value` its number or numbers; `inputs` are the files that define the
    problem. `history` is the method of `ContactSolver` for bodies that change with time, and its arguments, or None.
    Raises InputError if an option is not allowed, or if an output would replace one of these files.
    """

    def __init__(self, kind, value, history, options, parsed, inputs, tilting):
        output, csv = options["output"], options["path_csv"]
        self.kind, self.history, self.inputs = kind, history, inputs
        self.numbers = value if isinstance(value, tuple) else (value,) * history[2]
        self.fields, self.resume, self.tilting = options["path_fields"], options["resume"], tilting
        if self.fields and not output:
            raise InputError("-path_fields: needs -output, next to which the files of the steps are written")
        if history and (self.resume or options["flow"] or tilting):
            name = "resume" if self.resume else min(tilting, default="flow")
            raise InputError(f"-{name}: not for bodies that creep or wear")
        if self.resume and not (output or csv):
            raise InputError("-resume: needs -output or -path_csv, next to which finished steps are stored")
        csv = csv or (output and Path(output).with_suffix(".csv"))
        self.output, self.csv = output and Path(output), csv and Path(csv)
        self.journal = csv and not history and self.csv.with_suffix(".path.jsonl")
        protected = [*parsed.files, *inputs]
        if csv:
            check_output_path(csv, protected, "path table", (".csv",))
        if self.journal:
            what = f"path table {csv}: file of finished steps"
            check_output_path(self.journal, protected, what, (".jsonl",))
        relevant = {name: text for name, text in parsed.texts.items() if name not in _OUTPUT_OPTIONS}
        self.relevant_options = format_options(relevant)
        if self.fields:
            steps = [self.step_file(step) for step in range(1, len(self.numbers) + 1)]
            equal = {self.output.with_name(Path(name).name) for name in protected}
            for file in {steps[-1], *equal.intersection(steps)}:  # the longest name, and names of inputs
                check_output_path(file, protected)

    def begin(self, solver, stiffness, flow):
        """Return the LoadPath, after checks of the numbers. Collective."""
        loading = {self.kind: self.numbers} | self.tilting
        if not self.history:
            return solver.path(stiffness=stiffness, flow=flow, **loading)
        method, arguments, _ = self.history
        return getattr(solver, method)(**arguments, stiffness=stiffness, **loading)

    def step_file(self, step):
        """Return the path of a step's result file; steps begin with 1."""
        return self.output.with_name(f"{self.output.stem}_{step:04d}{self.output.suffix}")


def read_history(options):
    """Return the method of `ContactSolver` for bodies that creep or wear, its arguments, and the steps; or None."""
    names = [name for name in _HISTORIES if options.given(name)]
    if len(names) > 1:
        raise InputError(f"{' and '.join(f'-{name}' for name in names)}: at most one of them is allowed")
    if names == ["creep_times"]:
        return "creep", {"times": options["creep_times"]}, len(options["creep_times"])
    if names:
        names = {"coefficient": "wear_coefficient", "distance": "sliding_distance", "steps": "wear_steps"}
        return "wear", {name: options[option] for name, option in names.items()}, options["wear_steps"]
    return None


def run_path(request, solver, save, stiffness, flow):
    """Solve all steps of a load path. Collective.

    The function ``save(solution, file)`` writes the result of a step. `stiffness` and `flow` are arguments of
    `ContactSolver.path`. Return the LoadPath, the merged `notes` of all
    steps, the last Solution, and a context manager. The caller writes the last result inside a ``with`` block of the
    context manager, which removes the checkpoint at its end.
    """
    from tqdm import tqdm

    path = request.begin(solver, stiffness, flow)
    checkpoint = call_collectively(solver.comm, _Checkpoint, request, solver)
    rows, notes = solver.comm.bcast((checkpoint.rows, checkpoint.notes))
    path.resume_after(rows)
    if rows:
        print_output(f"{len(rows)} of {len(path)} steps are done already")
    notes = notes[: len(path) - 1]  # the last step is solved in any case
    hidden = True if solver.comm.rank else None  # None: hidden without a terminal
    with checkpoint.reported(len(path)):
        with tqdm(total=len(path), initial=len(rows), desc="path", unit="step", disable=hidden) as bar:
            for solution in path:
                row = path.rows[-1]
                if request.fields:
                    save(solution, request.step_file(row["step"]))
                notes.append(solution.notes)
                call_collectively(solver.comm, checkpoint.add, row, solution.notes)
                _show_step(row, bar, (*path.coordinates, request.kind))
        if request.csv:
            call_collectively(solver.comm, path.save, request.csv)
    path.notes = merge_notes(notes)
    return path, solution, checkpoint.removed(len(path))


def merge_notes(notes):
    """Return each note (warning) of a load path with its steps.

    Notes that differ only in numbers are merged into one, with ranges of the numbers.
    """
    merged = {}
    for step, lines in enumerate(notes, 1):
        patterns = [_PLURAL.sub(r"\1", _NUMBER.sub("#", line)) for line in lines]
        for k, line in enumerate(lines):  # keep several notes of one pattern, as of two surfaces
            merged.setdefault((patterns[k], patterns[:k].count(patterns[k])), []).append((step, line))
    return [
        f"{format_steps([step for step, _ in group], len(notes))}: {_merge_lines([line for _, line in group])}"
        for group in merged.values()
    ]


def _merge_lines(lines):
    """Merge lines that differ only in numbers into one line with ranges.

    Nouns are in the plural if they are in the plural in one of the lines.
    """
    columns = zip(*([number[0] for number in _NUMBER.finditer(line)] for line in lines), strict=True)
    ends = ((min(column, key=float), max(column, key=float)) for column in columns)
    ranges = (low if float(low) == float(high) else f"{low} to {high}" for low, high in ends)
    longest = max(lines, key=lambda line: len(_NUMBER.sub("#", line)))
    return _NUMBER.sub(lambda _: next(ranges), longest)


class _Checkpoint:
    """Checkpoint of a path: a journal of finished steps on rank 0.

    Without a file there is no journal. `rows` and `notes` belong to the finished steps.
    """

    def __init__(self, request, solver):
        self.rows, self.notes, self._journal = [], [], None
        if solver.comm.rank or not request.journal:
            return
        self._file, count = request.journal, len(request.numbers)
        self._inputs = {"what": hash_inputs(request, solver)}
        self._journal = Journal(self._file, request.resume)
        outcomes, discarded = self._journal.outcomes, self._journal.discarded
        if outcomes and outcomes.get("path") != self._inputs:
            self._journal.close()
            raise InputError(
                f"-resume: {self._file} is of a run with other options, files, ranks or program; "
                "without -resume the path starts at its first step"
            )
        while (key := str(step := len(self.rows) + 1)) in outcomes:
            if request.fields and not (file := request.step_file(step)).is_file():
                note(f"-resume: there is no {file}; step {step} of {count} comes first")
                break
            row = dict(outcomes[key])
            self.notes.append(row.pop("notes", ()))
            self.rows.append(row)
        if request.resume and "1" not in outcomes:
            note(
                f"-resume: nothing to continue: {self._file} has no steps, or was removed when the path was "
                f"finished; step 1 of {count} comes first"
            )
        if steps := sum(key.isdigit() for key in discarded):
            advice = "; -resume continues after them" if discarded.get("path") == self._inputs else ""
            warn(
                f"{self._file}: the first finished step replaces {steps} steps of an interrupted run{advice}"
            )

    def add(self, row, notes):
        """Record a finished step's row and notes."""
        if self._journal:
            if "path" not in self._journal.outcomes:
                self._journal.add("path", self._inputs)
            self._journal.add(str(row["step"]), {**row, "notes": notes})

    @contextmanager
    def reported(self, steps):
        """Print the number of finished steps if a ``with`` block is interrupted."""
        try:
            yield
        except BaseException:
            if self._journal and (finished := len(self._journal.outcomes) - 1) > 0:
                note(f"{finished} of {steps} steps are stored in {self._file}; -resume continues after them")
            raise

    @contextmanager
    def removed(self, steps):
        """Remove the journal's file after a ``with`` block."""
        with self.reported(steps):
            yield
        if self._journal:
            self._journal.close()
            remove(self._file)


def hash_inputs(request, solver):
    """Return a hash of everything on which a path's table depends."""
    files = [hash_file(name) for name in request.inputs if Path(name).is_file()]
    parts = (request.relevant_options, *files, request.kind, *request.numbers, solver.comm.size, __version__)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def _show_step(row, bar, first):
    """Show a load step's numbers, the `first` ones first, in the progress bar, or print them."""
    units = {name: f" {unit_of(name)}".removesuffix(" 1") for name in (*first, *_SHOWN)}
    numbers = ", ".join(f"{name.replace('_', ' ')} {row[name]:.6g}{unit}" for name, unit in units.items())
    failed = "" if row["converged"] else ", NOT CONVERGED"
    if bar.disable:
        print_output(f"step {row['step']} of {bar.total}: {numbers}{failed}")
    else:
        bar.set_postfix_str(f"{numbers}{failed}", refresh=False)
        bar.update(row["step"] - bar.n)


def format_steps(steps, count):
    """Return a text that names steps out of `count` load steps.

    Examples
    --------
    >>> format_steps([1, 2, 3, 7], 8), format_steps([4], 8), format_steps([1, 2], 2), format_steps([1], 1)
    ('steps 1 to 3, 7', 'step 4', 'all steps', 'step 1')
    """
    if len(steps) == count > 1:
        return "all steps"
    ends = [k for k in range(len(steps)) if steps[k : k + 2] != [steps[k], steps[k] + 1]]
    ranges = [steps[first : last + 1] for first, last in zip([0, *(k + 1 for k in ends)], ends, strict=False)]
    texts = [f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in ranges]
    return f"step{'s'[: len(steps) > 1]} {', '.join(texts)}"


def load_path_summary(path, request):
    """Return a text that summarises a load path.

    The line has the numbers of steps and failures, the work, and the name of the table.
    """
    failed = [row["step"] for row in path.rows if not row["converged"]]
    state = f"{format_steps(failed, len(path))} NOT CONVERGED" if failed else "all solved"
    table = f"; table in {request.csv}" if request.csv else ""
    lines = [
        f"path of {format_count(len(path), 'step')}: {state}; {path.operator_applications:.4g} operator applications, "
        f"{path.solve_seconds:.3g} s{table}"
    ]
    kind = request.kind
    for name in ("percolates_x", "percolates_y"):
        for one, other in pairwise(path.rows):
            if one.get(name) != other.get(name):
                change = (
                    f"{'closes' if one[name] else 'opens'} in {name[-1]} between {kind.replace('_', ' ')}"
                )
                lines.append(f"the gap {change} {one[kind]:.6g} and {other[kind]:.6g} {unit_of(kind)}")
    return "\n".join(lines)
