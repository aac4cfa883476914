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
# What the rows of a page are, in the order of the table.
PATCHES = {
    "benchmark-peers": "free patch",
    "benchmark-peers-1024": "free patch",
    "dilute": "free patch, less than 1% in contact",
    "benchmark-peers-periodic": "periodic patch, partial contact",
    "benchmark-peers-periodic-1024": "periodic patch, partial contact",
    "benchmark-peers-layer": "periodic patch, layer on a rigid base",
    "benchmark-peers-hardness": "periodic patch, with a hardness",
}
MAX_DILUTE = 1.0  # contact in percent
FULL_CONTACT = "load 3"  # a problem of periodic patches whose solution is one product


def rows_of(text):
    """Return the rows of the table of times of a page, as dicts of texts."""
    lines = text.split("\n## Times\n")[1].split("\n## ")[0].strip().splitlines()
    names, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return [dict(zip(names, row, strict=True)) for row in rows]


def ratios_of(rows):
    """Return the ratios of times for each loading and package: {loading: {package: [ratio, ...]}}.

    Rows without accurate answers of both programs have no ratio. Of dilute contact only rows below `MAX_DILUTE` count,
    of periodic patches only those in partial contact.
    """
    found = {}
    for row in rows:
        package, _, variant = row["solver"].partition(": ")
        is_dense = float(row.get("contact", "0").rstrip("%") or 0) > MAX_DILUTE
        is_full = row.get("problem") == FULL_CONTACT
        if variant and row["over ours"] and not row["note"] and not (is_dense or is_full):
            ratios = found.setdefault(row.get("given", "load"), {}).setdefault(package, [])
            ratios.append(float(row["over ours"]))
    return found


def spread(ratios):
    """Return the smallest and the largest ratio as text."""
    texts = dict.fromkeys(f"{ratio:.2g}" if ratio < 10 else f"{ratio:.0f}" for ratio in sorted(ratios))
    return " to ".join([*texts][:: max(len(texts) - 1, 1)])


def quoted_table(folder=NOTEBOOK, link="notebook"):
    """Return the table of ratios of all pages in `folder` that are there; `link` leads to them."""
    rows = []
    for name, patch in PATCHES.items():
        path = Path(folder) / f"{name}.md"
        if not path.exists():
            continue
        page_rows = rows_of(path.read_text(encoding="utf-8"))
        sizes = sorted({int(row["grid"].partition("^")[0]) for row in page_rows})
        cells = "² to ".join(map(str, dict.fromkeys((sizes[0], sizes[-1])))) + "²"
        rows += [
            {"patch": patch, "cells": cells, "prescribed": loading}
            | {title: spread(ratios.get(package, [])) for package, title in PACKAGES.items()}
            | {"rows": f"[{name}]({link}/{name}.md)"}
            for loading, ratios in sorted(ratios_of(page_rows).items(), reverse=True)
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
