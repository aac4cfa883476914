"""Tables of the paper's numbers and this program's, as text and Markdown."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from app.io.table import format_markdown, format_text
from app.paper.tables import HEADINGS, PAPER


class Entry(NamedTuple):
    """One entry of a table, with the paper's value and this program's.

    A value is a number, a pair (a count with work or convergence factor), or None if the method diverged.
    """

    row: str
    column: str
    paper: object
    ours: object

    def difference(self):
        """Difference of the two values, as text."""
        if self.paper is None or self.ours is None:
            return "" if self.paper is self.ours else "one diverged"
        if not isinstance(self.paper, list):
            return f"{self.ours / self.paper - 1:+.0%}"
        (p, q), (r, s) = self.paper, self.ours
        return f"{r - p:+d} ({s - q:+.2f})" if q < 1 else f"{r - p:+d} ({s / q - 1:+.0%})"


def format_entry(value):
    """Format a value as the paper does."""
    if value is None:
        return "diverged"
    if not isinstance(value, list):
        return f"{value:.2f}"
    first, second = value
    return f"{first} ({second:.2f})" if 0 < second < 1 else f"{first} ({second:.0f})"


def pair_entries(name, ours):
    """Return the entries of a table, each with the paper's and our value.

    `name` is the name of the table; `ours` maps grid sizes to rows of this program's values.
    """
    paired = []
    for size, row in ours.items():
        grid = f"{size} × {size}"
        for column, value in row.items():
            theirs = PAPER[name][size][column]
            if column == "errors":
                # Iterations beyond the paper's last change nothing in the digits shown.
                for i, (p, q) in enumerate(zip(theirs, value or [None] * len(theirs), strict=False)):
                    paired.append(Entry(grid, f"before iteration {i + 1}", p, q))
            else:
                paired.append(Entry(grid, _column(name, column), theirs, value))
    return paired


def _column(name, column):
    if name == "table1":
        return f"ω = {column}"
    if name == "table8":
        return f"{column} iterations"
    return {**HEADINGS, "discrete": "discretisation"}[column]


def summarize(pairs):
    """Return a sentence on how many entries equal the paper's."""
    same = sum(format_entry(entry.paper) == format_entry(entry.ours) for entry in pairs)
    return f"{len(pairs)} entries, {same} of them equal in all digits printed."


# -- sections ----------------------------------------------------------------------------------------------

_HEAD = f"""# A full multigrid method for elastic contact: tables and figures from real runs

The numbers of {PAPER["source"]} next to those of this program, each from a run of its own. In brackets: work units.
"""


class Section(NamedTuple):
    """Section of the report: a table or picture, and a note."""

    name: str
    title: str
    rows: Sequence = ()  # of the table, each a mapping from heading to text
    picture: str = ""  # name of the picture's file
    note: str = ""

    def text(self):
        """Format the table for the terminal."""
        return f"{self.name}  {self.title}\n{format_text(self.rows)}"

    def markdown(self):
        """Format heading, picture or table, and note in Markdown."""
        kind, number = re.fullmatch(r"(table|fig|)(.*)", self.name).groups()
        label = {"table": f"Table {number}: ", "fig": f"Figure {number}: "}.get(kind, "")
        content = f"![{self.title}]({self.picture})\n" if self.picture else format_markdown(self.rows)
        return "\n".join([f"## {label}{self.title}\n", content, *([f"{self.note}\n"] if self.note else [])])


def table_section(item, ours):
    """Return the section of a table.

    `ours` has this program's numbers, in the form of ``tables.json``.
    """
    pairs = pair_entries(item.name, ours)
    headings = "grid", "", "paper", "ours", "difference"
    rows = [(e.row, e.column, format_entry(e.paper), format_entry(e.ours), e.difference()) for e in pairs]
    rows = [dict(zip(headings, row, strict=True)) for row in rows]
    note = " ".join(filter(None, (item.note, summarize(pairs))))
    return Section(item.name, item.title, rows, note=note)


def format_page(sections, facts):
    """Format sections as one Markdown page, with a text of facts at its head."""
    return "\n".join([_HEAD, f"{facts}\n", *(section.markdown() for section in sections)])
