"""Tables, studies and figures of the reproduction, with the runs they need."""

from collections.abc import Callable
from dataclasses import dataclass

from app.options.option_table import FILES
from app.parameter_study.run import Run

CASES = {1: "-0.11", 2: "0.01", 3: "0.25"}  # approach of the rough punch [mm], Sec. 5.2


@dataclass(frozen=True)
class Limits:
    """Limits of a reproduction: largest grid, and number of random surfaces.

    `largest` is the largest number of cells per side. `seeds` is the number of random surfaces in addition to the one
    of the tables.
    """

    largest: int = 256
    seeds: int = 10

    def sizes(self, *sizes):
        """Return those of the given grid sizes that are not too large."""
        return [n for n in sizes if n <= self.largest]


FULL, QUICK = Limits(), Limits(largest=64, seeds=2)


@dataclass(frozen=True)
class Item:
    """A table, a study or a figure.

    Parameters
    ----------
    name : str
        Name on the command line and of the files.
    kind : str
        "table", "study" or "figure".
    title : str
        Title in the report.
    plan : callable
        Function ``plan(limits, scratch)`` that returns a mapping of cases (tuples of str) to their Run. `scratch` is a
        folder for input files.
    evaluate : callable
        Function ``evaluate(outcomes)`` that returns data of JSON types, or a figure of matplotlib. `outcomes` maps
        cases to outcomes of their runs.
    note : str
        Remark for the reader.
    why : str
        Reason why our numbers differ noticeably from the paper's.
    """

    name: str
    kind: str
    title: str
    plan: Callable
    evaluate: Callable
    note: str = ""
    why: str = ""


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
