"""Tables, studies and figures of the reproduction, with their runs."""

from collections.abc import Callable
from dataclasses import dataclass

from app.options.option_table import FILES
from app.parameter_study.run import Run

CASES = {1: "-0.11", 2: "0.01", 3: "0.25"}  # approach of the rough punch [mm], Sec. 5.2


@dataclass(frozen=True)
class Limits:
    """Side of the largest grid, and number of other random surfaces."""

    largest: int = 256
    seeds: int = 10

    def sizes(self, *sizes):
        """Return the sizes up to the largest grid."""
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
    plan : callable
        (Limits, folder for input files) -> mapping of cases (tuples of str) to their Run.
    evaluate : callable
        Mapping of cases to outcomes of their runs -> data of JSON types, or a Figure.
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
    """Return the run of a problem file with a method file on n x n cells.

    Options that are None are left out.
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
