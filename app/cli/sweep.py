"""Run app.solve for all combinations of option values: ``python -m app.sweep SWEEP.yml -o out.csv``.

Each combination is run as a process (under mpiexec for ``--ranks`` above 1) and becomes a row of the table. Finished
runs are stored in ``out.runs.jsonl``; ``--resume`` skips them if options, their files and the program are unchanged.
Exit status: 0 if all runs are solved; 3 if some are not; 2 if all are refused, or for bad input before any run; 130 if
interrupted, with a table of the finished runs.
"""

from pathlib import Path

from app.cli import streams
from app.cli.arguments import Parser, check_ranks, command, count, positive
from app.io.files import check_output_path
from app.io.table import format_text, write_table
from app.parameter_study.batch import make_rows, run_all
from app.parameter_study.journal import Journal
from app.parameter_study.run import CHECKS
from app.parameter_study.sweep_file import read_sweep

SUFFIXES = (".csv", ".md", ".txt", ".h5", ".hdf5")
_SHOWN = (
    "contact_fraction", "max_pressure", "mean_gap", "load", "approach", "active_set_iterations",
    "operator_applications", "solve_seconds",
)  # fmt: skip
_MAX_LISTED = 4  # runs with the same message


@command
def main(argv):
    """Run the command and return its exit status."""
    what = "Run app.solve for every combination of option values."
    parser = Parser(prog="python -m app.sweep", description=what)
    table = f"table: {' '.join(SUFFIXES)}"
    again = "keep finished runs of an earlier call; repeat refused ones"
    add = parser.add_argument
    add("sweep", type=Path, metavar="SWEEP.yml", help="options and their values; see petsc_options/sweeps/")
    add("-o", "--output", type=Path, required=True, metavar="TABLE", help=table)
    add("--jobs", type=count, default=1, metavar="N", help="runs at a time; default: 1")
    add("--ranks", type=count, default=1, metavar="P", help="MPI ranks of each run; default: 1")
    add("--timeout", type=positive, metavar="S", help="stop a run after S seconds")
    add("--resume", action="store_true", help=again)
    add("--keep", action="store_true", help="keep the result files, for a table out.csv in out.runs/")
    arguments = parser.parse_args(argv)
    output = arguments.output
    check_ranks(arguments.ranks)
    runs = read_sweep(arguments.sweep)
    inputs = {arguments.sweep, *(file for run in runs for file in run.inputs())}
    check_output_path(output, inputs, "-o", SUFFIXES)
    journal_file = output.with_suffix(".runs.jsonl")
    check_output_path(journal_file, inputs, f"-o {output}: file of finished runs", (".jsonl",))
    journal = Journal(journal_file, arguments.resume)
    try:
        outcomes, interrupted = run_all(
            runs, output.with_suffix(".runs"), journal, jobs=arguments.jobs, ranks=arguments.ranks,
            keep=arguments.keep, timeout=arguments.timeout, description=arguments.sweep.stem,
        )  # fmt: skip
    finally:
        journal.close()
    rows = make_rows(runs, outcomes)
    varied = dict.fromkeys(name for run in runs for name in run.labels)
    columns = [name for name in rows[0] if name != "result" or arguments.keep] if rows else list(varied)
    step = ["step"] if any("step" in row for row in rows) else []
    shown = dict.fromkeys([*varied, "exit_status", *step, *_SHOWN])
    if output.suffix.lower() in (".md", ".txt"):  # short enough to be read
        columns = [name for name in (*shown, *CHECKS, "message", "result") if name in columns]
    if rows or not output.exists():  # interrupted before the first, keep an earlier table
        write_table(output, rows, columns)
    streams.print_output(format_text(rows, list(shown), {name: ".4g" for name in _SHOWN}).rstrip("\n"))
    rows = [row for row in rows if row.get("step") in (None, 1)]  # one of each run
    for line in _merge_messages(rows, varied):
        streams.print_output(line)
    statuses = [row["exit_status"] for row in rows]
    solved = statuses.count(0)
    advice = "; interrupted: --resume continues after them" if interrupted and rows else ""
    streams.print_output(
        f"{len(rows)} of {len(runs)} runs in {output}; {solved} of {len(rows)} solved{advice}"
    )
    if interrupted:
        return 130
    if solved == len(rows):
        return 0
    return 2 if statuses.count(2) == len(rows) else 3


def _merge_messages(rows, varied):
    runs_of = {}
    for row in rows:
        options = ", ".join(f"{name} {row[name]}" for name in varied if row[name] is not None)
        if row["message"]:
            runs_of.setdefault(row["message"], []).append(options)
    for message, runs in runs_of.items():
        if len(runs) == len(rows) > 1:
            runs = ["all runs"]
        elif len(runs) > _MAX_LISTED:
            runs = [*runs[: _MAX_LISTED - 1], f"and {len(runs) - _MAX_LISTED + 1} more"]
        yield f"{'; '.join(runs)}: {message}".removeprefix(": ")
