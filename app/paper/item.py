"""What can be reproduced: an item plans runs and makes numbers or a picture from what they find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from app.options.option_table import FILES
from app.parameter_study.run import Run

CASES = {1: "-0.11", 2: "0.01", 3: "0.25"}  # approach of the rough punch [mm], Sec. 5.2


@dataclass(frozen=True)
class Limits:
    """How much to do: side of the largest grid, number of other random surfaces."""

    largest: int = 256
    seeds: int = 10

    def sizes(self, *sizes):
        """Return those of the sizes that are not too large."""
        return [n for n in sizes if n <= self.largest]


FULL, QUICK = Limits(), Limits(largest=64, seeds=2)


@dataclass(frozen=True)
class Item:
    """A table, a study or a figure.

    Parameters
    ----------
    name : str
        On the command line, and of its files.
    kind : str
        "table", "study" or "figure".
    title : str
    plan : callable
        (Limits, folder for input files) -> mapping of a tuple that names the case to its Run.
    evaluate : callable
        Mapping of those tuples to the outcomes of the runs -> data of JSON types for tables and studies, or a
        Figure.
    note : str
        What a reader should know about it.
    why : str
        Why our numbers differ noticeably from the paper's, if they do.
    """

    name: str
    kind: str
    title: str
    plan: Callable
    evaluate: Callable
    note: str = ""
    why: str = ""


def solver_run(problem, method, n, **options):
    """Run of a problem file with a method file on n x n cells; None among the options leaves one out."""
    files = [str(FILES / f"{name}.opts") for name in (problem, method) if name]
    given = {name: str(value) for name, value in options.items() if value is not None}
    return Run(tuple(files), {"grid": str(n), **given})


def nest(flat):
    """Turn ``{("a", "b"): value}`` into ``{"a": {"b": value}}``."""
    nested = {}
    for (row, column), value in flat.items():
        nested.setdefault(row, {})[column] = value
    return nested
