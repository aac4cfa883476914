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
the program refuses it, diverges or crashes: then `exit_status` and `message` say so; a load path has a row for each
step, numbered in `step`, of which the last has what is known of the whole run. The result files give
`largest_penetration` [mm], `smallest_pressure` [N/mm2] and `complementarity`, max |p e| / (max p max |h|).
What is finished is kept in ``out.runs.jsonl`` beside the table; ``--resume`` goes on from there, as far as options,
the files they name, and the program are the same; what was refused, or crashed, is tried again.

Exit status: 0 all runs solved; 3 some are not, as the table says; 2 all are refused, or bad input before any run; 130
interrupted, with a table of what is finished.
"""

from __future__ import annotations

from pathlib import Path

from app.cli import streams
from app.cli.arguments import Parser, check_ranks, command, count, positive
from app.io.files import check_output_path
from app.io.table import format_text, write_table
from app.parameter_study.batch import make_rows, run_all
from app.parameter_study.journal import Journal
from app.parameter_study.sweep_file import read_sweep

SUFFIXES = (".csv", ".md", ".txt", ".h5", ".hdf5")
_SHOWN = (
    "contact_fraction", "max_pressure", "mean_gap", "load", "approach", "active_set_iterations",
    "operator_applications", "solve_seconds",
)  # fmt: skip
_MOST_NAMED = 4  # runs that say the same


@command
def main(argv):
    """Run the command and return its exit status."""
    what = "Run app.solve for every combination of option values."
    parser = Parser(prog="python -m app.sweep", description=what)
    table = f"table: {' '.join(SUFFIXES)}"
    again = "keep what an earlier call has finished; what was refused is tried again"
    add = parser.add_argument
    add("sweep", type=Path, metavar="SWEEP.yml", help="what to vary; see petsc_options/sweeps/")
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
    kept = output.with_suffix(".runs.jsonl")
    check_output_path(kept, inputs, f"-o {output}: file of finished runs", (".jsonl",))
    journal = Journal(kept, arguments.resume)
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
    if rows or not output.exists():  # interrupted before the first: a table of before stays, like the journal
        write_table(output, rows, columns)
    known = ("step", *_SHOWN) if any("step" in row for row in rows) else _SHOWN
    shown = dict.fromkeys([*varied, "exit_status", *known])  # a varied load has its column
    streams.print_output(format_text(rows, list(shown), {name: ".4g" for name in _SHOWN}).rstrip("\n"))
    rows = [row for row in rows if row.get("step") in (None, 1)]  # of each run one
    for line in _messages(rows, varied):
        streams.print_output(line)
    statuses = [row["exit_status"] for row in rows]
    solved = statuses.count(0)
    going_on = "; interrupted: --resume goes on after them" if interrupted and rows else ""
    streams.print_output(
        f"{len(rows)} of {len(runs)} runs in {output}; {solved} of {len(rows)} solved{going_on}"
    )
    if interrupted:
        return 130
    if solved == len(rows):
        return 0
    return 2 if statuses.count(2) == len(rows) else 3


def _messages(rows, varied):
    """What runs say, each message once, with the varied options of the runs that say it."""
    said = {}
    for row in rows:
        which = ", ".join(f"{name} {row[name]}" for name in varied if row[name] is not None)
        if row["message"]:
            said.setdefault(row["message"], []).append(which)
    for message, which in said.items():
        if len(which) == len(rows) > 1:
            which = ["all runs"]
        elif len(which) > _MOST_NAMED:
            which[_MOST_NAMED - 1 :] = [f"and {len(which) - _MOST_NAMED + 1} more"]
        yield f"{'; '.join(which)}: {message}".removeprefix(": ")
