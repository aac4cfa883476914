"""Copy the ratios of the pages of this benchmark into the tables of the user pages."""

import re
from pathlib import Path

from app.io.table import format_markdown
from benchmarks.measure import ROOT

NOTEBOOK = ROOT / "docs/notebook"
DOCUMENTS = ROOT / "docs/speed.md", ROOT / "docs/comparison.md"
BEGIN, END = "<!-- table of run/bench-peers --quote: begin -->\n", "<!-- end -->\n"
PACKAGES = {
    "aspher": "ASPHER",
    "slippy": "slippy",
    "tamaas": "Tamaas",
    "contactmechanics": "ContactMechanics",
}
MAX_DILUTE = 1.0  # contact in percent
FULL_CONTACT = "load 3"  # a problem of periodic patches whose solution is one product


def every(row):
    """Select all rows."""
    return True


def is_dilute(row):
    """Select rows with little contact."""
    return float(row["contact"].rstrip("%") or "inf") <= MAX_DILUTE


def is_partial(row):
    """Select rows without full contact."""
    return row["problem"] != FULL_CONTACT


def is_full(row):
    """Select rows in full contact by load; an approach does not determine the mean pressure there."""
    return row["problem"] == FULL_CONTACT and row["given"] == "load"


# Rows of the table: a page, what its selected rows are, and which ones are selected.
QUOTES = (
    ("benchmark-peers", "free patch", every),
    ("benchmark-peers-1024", "free patch", every),
    ("dilute", "free patch, less than 1% in contact", is_dilute),
    ("benchmark-peers-periodic", "periodic patch, partial contact", is_partial),
    ("benchmark-peers-periodic-1024", "periodic patch, partial contact", is_partial),
    ("benchmark-peers-periodic", "periodic patch, full contact", is_full),
    ("benchmark-peers-periodic-1024", "periodic patch, full contact", is_full),
    ("benchmark-peers-layer", "periodic patch, layer on a rigid base", every),
    ("benchmark-peers-hardness", "periodic patch, with a hardness", every),
)


def rows_of(text):
    """Return the rows of the table of times of a page, as dicts of texts."""
    lines = text.split("\n## Times\n")[1].split("\n## ")[0].strip().splitlines()
    names, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return [dict(zip(names, row, strict=True)) for row in rows]


def ratios_of(rows):
    """Return the ratios of times for each loading and package: {loading: {package: [ratio, ...]}}.

    Rows without accurate answers of both programs have no ratio.
    """
    found = {}
    for row in rows:
        package, _, variant = row["solver"].partition(": ")
        if variant and row["over ours"] and not row["note"]:
            ratios = found.setdefault(row.get("given", "load"), {}).setdefault(package, [])
            ratios.append(float(row["over ours"]))
    return found


def spread(ratios):
    """Return the smallest and the largest ratio as text."""
    texts = dict.fromkeys(f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}" for ratio in sorted(ratios))
    return " to ".join([*texts][:: max(len(texts) - 1, 1)])


def quoted_table(folder=NOTEBOOK):
    """Return the table of ratios of all pages in `folder`."""
    rows = []
    for name, patch, is_selected in QUOTES:
        page_rows = rows_of((Path(folder) / f"{name}.md").read_text(encoding="utf-8"))
        sizes = sorted({int(row["grid"].partition("^")[0]) for row in page_rows})
        cells = "² to ".join(map(str, dict.fromkeys((sizes[0], sizes[-1])))) + "²"
        rows += [
            {"patch": patch, "cells": cells, "prescribed": loading}
            | {title: spread(ratios.get(package, [])) for package, title in PACKAGES.items()}
            | {"page": f"[{name}](notebook/{name}.md)"}
            for loading, ratios in sorted(ratios_of(filter(is_selected, page_rows)).items(), reverse=True)
        ]
    return format_markdown(rows)


def replace_table(text, table):
    """Return a document with this table between the marks."""
    return re.sub(
        f"(?<={re.escape(BEGIN)}).*?(?={re.escape(END)})", lambda _: f"\n{table}\n", text, flags=re.DOTALL
    )


def write_quotes():
    """Write the table into all documents."""
    table = quoted_table()
    for path in DOCUMENTS:
        path.write_text(replace_table(path.read_text(encoding="utf-8"), table), encoding="utf-8")
