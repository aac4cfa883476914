"""Reproduce the paper's tables and figures: ``python -m app.reproduce [table1 fig8 ...|all] -o DIR``.

Items: table1 .. table8, and the figures fig2, fig5, fig6, fig7, fig8, fig10, fig11, fig12; `tables`, `figures` and
`all` (default) name several. In DIR:

- ``tables.json``: this program's numbers of the tables; ``report.json``: the checks;
- ``report.md``: the paper's numbers and this program's, with the pictures ``fig8.png`` ...;
- ``runs/table1.csv`` ...: every run with its options; ``runs.jsonl``: finished runs, which a second call skips.

Results of earlier calls in DIR are kept. Exit status: 0 all items done; 1 a run crashed or was refused, and its item is
left out; 2 bad input; 130 interrupted, with the complete items written.
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
from app.parameter_study.run import CHECKS, OUTCOME
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
    tables, rest = _read(folder / "tables.json"), _read(folder / "report.json")
    scratch = folder / "work"
    journal = Journal(folder / "runs.jsonl", resume=not arguments.fresh)
    started = time.perf_counter()
    try:
        plans = {item.name: item.plan(QUICK if arguments.quick else FULL) for item in items}
        cases = [(name, case) for name, plan in plans.items() for case in plan]
        runs = [plans[name][case] for name, case in cases]
        outcomes, interrupted = run_all(runs, scratch, journal, jobs=arguments.jobs, description="reproduce")
    finally:
        journal.close()
        shutil.rmtree(scratch, ignore_errors=True)
    found = {name: {} for name in plans}
    failures = {}
    for (name, case), outcome in zip(cases, outcomes, strict=True):
        found[name][case] = outcome
        if outcome and not _usable(outcome):
            failures.setdefault(name, f"{' '.join(case)}: {outcome['message']}")
    for name, message in failures.items():
        # Results of an earlier call are out of date.
        for data in (tables, *rest.values()):
            data.pop(name, None)
        for stale in folder / f"{name}.png", folder / "runs" / f"{name}.csv":
            stale.unlink(missing_ok=True)
        streams.print_error(f"{name}: left out, because a run failed: {message}")
    done = [item for item in items if all(map(_usable, found[item.name].values()))]
    _write(folder, tables, rest, done, plans, found, arguments.quick, time.perf_counter() - started)
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


def _write(folder, tables, rest, items, plans, found, quick, seconds):
    """Add the results of items to the folder, and print the results."""
    checks, made = (rest.setdefault(name, {}) for name in ("checks", "made"))
    tables["source"] = f"app.reproduce {__version__}, after {PAPER['source']}"
    (folder / "runs").mkdir(exist_ok=True)
    today = datetime.date.today().isoformat()
    for item in items:
        outcomes = found[item.name]
        result = item.evaluate(outcomes)
        if item.kind == "figure":
            save_figure(result, folder / f"{item.name}.png", dpi=130)
            streams.print_output(f"{item.name}  {item.title}: {folder / item.name}.png")
        else:
            tables[item.name] = {"what": item.title, **result}
            streams.print_output(report.table_section(item, result).text())
        made[item.name] = {"version": __version__, "date": today, "quick": quick, "runs": len(outcomes)}
        if item.kind == "figure":
            continue  # its runs are those of a table, or traces
        worst = worst_conditions(outcomes.values())
        if worst:
            checks[item.name] = worst
        if outcomes:
            runs = {case: " ".join(run.arguments()) for case, run in plans[item.name].items()}
            rows = [{"case": " ".join(case), **outcomes[case], "arguments": runs[case]} for case in outcomes]
            write_table(folder / "runs" / f"{item.name}.csv", rows, ["case", *OUTCOME, "arguments"])
    tables = {name: tables[name] for name in ("source", *ITEMS) if name in tables}
    for name, data in ("tables", tables), ("report", rest):
        write_text(folder / f"{name}.json", json.dumps(data, indent=1) + "\n")
    numbers = {name: data for name, data in tables.items() if name != "source"}
    for name, data in numbers.items():
        numbers[name] = {size: row for size, row in data.items() if size != "what"}
    pictures = {name: f"{name}.png" for name in ITEMS if (folder / f"{name}.png").is_file()}
    facts = [f"version {__version__}", today]
    if any(entry["quick"] for entry in made.values()):
        facts.append("some items were made with --quick, on small grids only")
    page = report.format_page(_reading_order(), numbers, pictures, checks, facts)
    write_text(folder / "report.md", page)
    streams.print_output(f"report: {folder / 'report.md'} ({seconds:.0f} s)")


def worst_conditions(outcomes):
    """Return the largest violations of complementarity in converged runs.

    The result is None if no run has a solution.
    """
    solved = [outcome for outcome in outcomes if all(name in outcome for name in CHECKS)]
    if not solved:
        return None
    good = [outcome for outcome in solved if outcome["converged"]]
    ends = {"largest_penetration": max, "smallest_pressure": min, "complementarity": max}
    worst = {name: end((outcome[name] for outcome in good), default=0.0) for name, end in ends.items()}
    return {"runs": len(solved), "not_converged": len(solved) - len(good), **worst}


def _reading_order():
    """Return the items in order: each table, then its figures."""
    behind = {"table1": ["fig2", "fig5", "fig6", "fig7"], "table3": ["fig8"], "table4": ["fig12", "fig10"],
              "table8": ["fig11"]}  # fmt: skip
    return [ITEMS[name] for item in TABLES for name in (item.name, *behind.get(item.name, []))]


def _read(path):
    try:
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); remove it") from None
