"""Tables and figures of the reproduction, with the runs they need."""

from collections.abc import Callable
from typing import NamedTuple

from app.options.option_table import FILES
from app.parameter_study.run import Run

CASES = {1: "-0.11", 2: "0.01", 3: "0.25"}  # approach of the rough punch [mm], Sec. 5.2


FULL, QUICK = 256, 64  # cells per side of the largest grids


class Item(NamedTuple):
    """A table or a figure.

    ``plan(largest)`` maps cases (tuples of str) to their Run, or to a function that returns their outcome.
    ``evaluate(outcomes)`` takes the outcome of each case, and returns data of JSON types, or a figure of matplotlib.
    """

    name: str  # on the command line and of the files
    kind: str  # "table" or "figure"
    title: str
    plan: Callable
    evaluate: Callable
    note: str = ""  # remark for the reader


def plan_grids(largest, sizes, columns, plan):
    """Return ``plan(n, value)`` for each n of `sizes` up to `largest`, and each of the `columns`, by name."""
    sizes = [n for n in sizes if n <= largest]
    return {(str(n), name): plan(n, value) for n in sizes for name, value in columns.items()}


def solver_run(problem, method, n, **options):
    """Return the `Run` that solves a problem on n x n cells.

    `problem` and `method` are names of option files. Options that are None are left out.
    """
    files = [str(FILES / f"{name}.opts") for name in (problem, method) if name]
    texts = {name: str(value) for name, value in options.items() if value is not None}
    return Run(tuple(files), {"grid": str(n), **texts})


def nest(flat):
    """Turn ``{("a", "b"): value}`` into ``{"a": {"b": value}}``."""
    nested = {}
    for (row, column), value in flat.items():
        nested.setdefault(row, {})[column] = value
    return nested
