"""Reproduce the paper's tables and figures: ``python -m app.reproduce [table1 fig8 ...|all] -o DIR``.

Items: table1 .. table8, and the figures fig2, fig5, fig6, fig7, fig8, fig10, fig11, fig12; `tables`, `figures` and
`all` (default) name several. In DIR:

- ``tables.json``: this program's numbers of the tables;
- ``report.md``: the paper's numbers and this program's, with the pictures ``fig8.png`` ...;
- ``runs/table2.csv`` ...: every run with its options and how well it keeps the conditions of contact;
- ``runs.jsonl``: finished runs, which a second call skips.

Tables and report are of the items of the last call. Exit status: 0 all items done; 1 a run crashed or was refused, and
its item is left out; 2 bad input; 130 interrupted, with the complete items written.
"""

import datetime
import json
import os
import shutil
import time
from pathlib import Path

from app import __version__
from app.base.errors import InputError
from app.cli import streams
from app.cli.arguments import Parser, check_folder, command, count
from app.io.files import write_text
from app.io.table import write_table
from app.paper import report
from app.paper.item import FULL, QUICK
from app.paper.pictures import FIGURES
from app.paper.tables import PAPER, TABLES
from app.parameter_study.batch import run_all
from app.parameter_study.journal import Journal
from app.parameter_study.run import OUTCOME, Run
from app.plots.style import save_figure

ITEMS = {item.name: item for item in (*TABLES, *FIGURES)}
GROUPS = {"tables": TABLES, "figures": FIGURES, "all": [*ITEMS.values()]}


@command
def main(argv):
    """Run the command and return its exit status."""
    what, jobs = "Compute the paper's tables and figures.", len(os.sched_getaffinity(0))
    parser = Parser(prog="python -m app.reproduce", description=what)
    add, items = parser.add_argument, f"{', '.join([*ITEMS, *GROUPS])}; default: all"
    add("items", nargs="*", metavar="ITEM", help=items)
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    add("--jobs", type=count, default=jobs, metavar="N", help="runs at a time; default: all cores")
    add("--quick", action="store_true", help="small grids only")
    add("--fresh", action="store_true", help="do all runs again")
    arguments = parser.parse_args(argv)
    items = select_items(arguments.items or ["all"])
    folder = arguments.output
    check_folder(folder)
    folder.mkdir(exist_ok=True)
    scratch = folder / "work"
    journal = Journal(folder / "runs.jsonl", resume=not arguments.fresh)
    started = time.perf_counter()
    try:
        plans = {item.name: item.plan(QUICK if arguments.quick else FULL) for item in items}
        runs = {
            (name, case): run
            for name, plan in plans.items()
            for case, run in plan.items()
            if isinstance(run, Run)
        }
        outcomes, interrupted = run_all(
            [*runs.values()], scratch, journal, jobs=arguments.jobs, description="reproduce"
        )
    finally:
        journal.close()
        shutil.rmtree(scratch, ignore_errors=True)
    found = {name: {} for name in plans}
    failures = {}
    for (name, case), outcome in zip(runs, outcomes, strict=True):
        found[name][case] = outcome
        if outcome and not _usable(outcome):
            failures.setdefault(name, f"{' '.join(case)}: {outcome['message']}")
    for name, message in failures.items():
        streams.print_error(f"{name}: left out, because a run failed: {message}")
    done = [item for item in items if all(map(_usable, found[item.name].values()))]
    _write(folder, done, plans, found, arguments.quick, time.perf_counter() - started)
    return 130 if interrupted else int(bool(failures))


def _usable(outcome):
    return outcome is not None and outcome["exit_status"] in (0, 3)


def select_items(names):
    """Return the items with given names or groups, in the report's order."""
    chosen = set()
    for name in names:
        if name not in ITEMS and name not in GROUPS:
            raise InputError(f"item {name}: unknown; allowed: {', '.join([*ITEMS, *GROUPS])}")
        chosen |= {item.name for item in GROUPS.get(name, [ITEMS.get(name)])}
    return [item for item in ITEMS.values() if item.name in chosen]


def _write(folder, items, plans, found, quick, seconds):
    """Write the results of items to the folder, and print them."""
    sections, tables = [], {"source": f"app.reproduce {__version__}, after {PAPER['source']}"}
    (folder / "runs").mkdir(exist_ok=True)
    for item in items:
        outcomes, plan = found[item.name], plans[item.name]
        result = item.evaluate(
            {case: outcomes[case] if case in outcomes else run() for case, run in plan.items()}
        )
        if item.kind == "figure":
            picture = folder / f"{item.name}.png"
            save_figure(result, picture, dpi=130)
            streams.print_output(f"{item.name}  {item.title}: {picture}")
            sections.append(report.Section(item.name, item.title, picture=picture.name, note=item.note))
            continue
        tables[item.name] = {"what": item.title, **result}
        sections.append(report.table_section(item, result))
        streams.print_output(sections[-1].text())
        rows = [
            {"case": " ".join(case), **outcome, "arguments": " ".join(plan[case].arguments())}
            for case, outcome in outcomes.items()
        ]
        if rows:
            write_table(folder / "runs" / f"{item.name}.csv", rows, ["case", *OUTCOME, "arguments"])
    write_text(folder / "tables.json", json.dumps(tables, indent=1) + "\n")
    facts = f"version {__version__} · {datetime.date.today()}" + " · --quick: small grids only" * quick
    write_text(folder / "report.md", report.format_page(sections, facts))
    streams.print_output(f"report: {folder / 'report.md'} ({seconds:.0f} s)")
