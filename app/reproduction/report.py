"""Side by side: the paper's numbers and ours, for the terminal, in Markdown and as a web page."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass

from app.output.table import markdown, text
from app.reproduction.tables import HEADINGS, PAPER

# What counts as a noticeable difference: iterations or cycles, share of the work or error, convergence factor.
ITERATIONS, SHARE, FACTOR = 2, 0.1, 0.03
_NAMED = 5  # differences that are named one by one
_STUDY_HEADINGS = {
    "case": "case",
    "grid": "grid",
    "method": "method",
    "cg_iterations": "CG iterations",
    "relative_load": "mean pressure / (E* slope)",
    "surfaces": "surfaces",
    "not_solved": "not solved",
    "contact": "contact share",
    "share": "contact share",
    "kappa": "slope",
    "middle_share": "share, middle",
    "middle_kappa": "slope, middle",
    "iterations": "iterations",
    "work_units": "work units",
    "operator_applications": "operator applications",
    "solve_seconds": "seconds",
    "load": "load [N]",
}
_METHODS = HEADINGS | {"fmg_v11": "full multigrid V(1,1)", "fast": "fast.opts"}
_FORMATS = {"work_units": ".4g", "operator_applications": ".4g", "solve_seconds": ".3g", "load": ".8g"}
_TRIPLES = "Triples are minimum · median · maximum over the surfaces."


@dataclass(frozen=True)
class Entry:
    """One number of a table, or pair of numbers, by the paper and by us; None: diverged or not available."""

    row: str
    column: str
    paper: object
    ours: object

    @property
    def noticeable(self):
        """Whether the two differ by more than the last digit or the last iteration."""
        if self.paper is None or self.ours is None:
            return (self.paper is None) != (self.ours is None)
        if not isinstance(self.paper, list):
            return abs(self.ours / self.paper - 1) > SHARE
        (p, q), (r, s) = self.paper, self.ours
        return abs(p - r) >= ITERATIONS or (abs(q - s) > FACTOR if q < 1 else abs(s / q - 1) > SHARE)

    def difference(self):
        """Ours minus the paper's in words of a table cell."""
        if self.paper is None or self.ours is None:
            return "" if self.paper is self.ours else "one diverged"
        if not isinstance(self.paper, list):
            return f"{self.ours / self.paper - 1:+.0%}"
        (p, q), (r, s) = self.paper, self.ours
        return f"{r - p:+d} ({s - q:+.2f})" if q < 1 else f"{r - p:+d} ({s / q - 1:+.0%})"


def show(value):
    """Write an entry as the paper does."""
    if value is None:
        return "diverged"
    if not isinstance(value, list):
        return f"{value:.2f}"
    first, second = value
    return f"{first} ({second:.2f})" if 0 < second < 1 else f"{first} ({second:.0f})"


def entries(name, ours):
    """Pair the paper's table with ours, on the sizes that we have: list of Entry."""
    paired = []
    for size, row in ours.items():
        grid = f"{size} × {size}"
        for column, value in row.items():
            theirs = PAPER[name].get(size, {}).get(column)
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


def verdict(found):
    """One sentence on how far the two are apart."""
    noticeable = [entry for entry in found if entry.noticeable]
    same = sum(show(entry.paper) == show(entry.ours) for entry in found)
    told = f"{len(found)} entries, {same} of them equal in all digits printed"
    if not noticeable:
        return f"{told}; no noticeable difference."
    if len(noticeable) > _NAMED:
        return f"{told}; {len(noticeable)} noticeably different."
    names = ", ".join(f"{entry.row} {entry.column}" for entry in noticeable)
    return f"{told}; noticeably different: {names}."


def table_text(item, ours):
    """Table of an item for the terminal."""
    rows = _long_rows(entries(item.name, ours))
    return f"{item.name}  {item.title}\n{text(rows)}"


def table_markdown(item, ours):
    """Table of an item in Markdown."""
    found = entries(item.name, ours)
    return f"## {_heading(item)}\n\n{markdown(_long_rows(found))}\n{_comment(item, found)}\n"


def study_text(item, data):
    """Table of a study for the terminal."""
    return f"{item.name}  {item.title}\n{text(_study_rows(data))}"


def study_markdown(item, data):
    """Table of a study in Markdown."""
    return f"## {_heading(item)}\n\n{markdown(_study_rows(data))}\n{_study_comment(item, data)}\n"


def checks_markdown(checks):
    """Table of the complementarity conditions in Markdown."""
    return f"## {CHECKS_TITLE}\n\n{markdown(_check_rows(checks))}\n{CHECKS_NOTE}\n"


CHECKS_TITLE = "Complementarity conditions"
CHECKS_NOTE = (
    "Worst values over all converged runs of an item: gap e < 0 [mm], pressure p < 0 [N/mm²], and "
    "max |p e| / (max p max |h|). Residuals of 1e-6 of the size of h are what (5.1) asks for."
)


def _heading(item):
    if item.kind == "table":
        return f"Table {item.name.removeprefix('table')}: {item.title}"
    if item.name.startswith("fig"):
        return f"Figure {item.name.removeprefix('fig')}: {item.title}"
    return item.title


def _comment(item, found):
    why = item.why if any(entry.noticeable for entry in found) else ""
    return " ".join(filter(None, (item.note, verdict(found), why)))


def _study_comment(item, data):
    triples = any(isinstance(value, list) for row in data["rows"] for value in row.values())
    return " ".join(filter(None, (item.note, _TRIPLES if triples else "")))


def _long_rows(found):
    return [
        {
            "grid": entry.row,
            "": entry.column,
            "paper": show(entry.paper),
            "ours": show(entry.ours),
            "difference": entry.difference(),
        }
        for entry in found
    ]


def _study_rows(data):
    return [
        {_STUDY_HEADINGS[name]: _study_cell(name, row[name]) for name in row if name in _STUDY_HEADINGS}
        for row in data["rows"]
    ]


def _study_cell(name, value):
    if name == "method":
        return _METHODS[value]
    if isinstance(value, list):
        spec = ".2%" if name.endswith(("share", "contact")) else ".3g"
        return " · ".join(format(number, spec) for number in value)
    return "" if value is None else format(value, _FORMATS.get(name, ""))


def _check_rows(checks):
    return [
        {
            "item": name,
            "runs": row["runs"],
            "not converged": row["not_converged"],
            "worst negative gap": f"{row['worst_negative_gap']:.1e}",
            "worst negative pressure": f"{row['worst_negative_pressure']:.1e}",
            "complementarity": f"{row['complementarity']:.1e}",
        }
        for name, row in checks.items()
    ]


# -- the web page ------------------------------------------------------------------------------------------

_CSS = """
:root { color-scheme: light; --ink: #1c2733; --pale: #5d6b79; --line: #d9e0e6; --blue: #0072b2; --orange: #b34a00; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 62rem; padding: 1.5rem 1.2rem 4rem; color: var(--ink); background: #fff;
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0.5rem 0; }
h2 { font-size: 1.15rem; margin: 2.8rem 0 0.6rem; padding-top: 0.6rem; border-top: 1px solid var(--line); }
p { max-width: 46rem; }
nav { display: flex; flex-wrap: wrap; gap: 0.3rem 0.9rem; margin: 1.2rem 0; }
a { color: var(--blue); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.93rem; }
th, td { padding: 0.28rem 0.8rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
th { font-weight: 600; vertical-align: bottom; }
td small, th small { display: block; color: var(--pale); font-size: 0.82rem; font-weight: 400; }
td.off { color: var(--orange); font-weight: 600; }
td.off small { color: var(--orange); }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; display: block; }
.pale { color: var(--pale); font-size: 0.93rem; }
@media print { body { max-width: none; } h2 { break-after: avoid; } figure, table { break-inside: avoid; } }
"""


def web_page(items, tables, studies, pictures, checks, facts):
    """Write the report as one HTML file with its pictures inside.

    Parameters
    ----------
    items : sequence of Item
        In the order of the page; those without a result are left out.
    tables, studies : mapping
        Item name -> data.
    pictures : mapping
        Item name -> PNG as bytes.
    checks : mapping
        Item name -> worst values of the complementarity conditions.
    facts : mapping
        What to say about the making of it: heading -> text.

    Returns
    -------
    str
    """
    sections, links = [], []
    for item in items:
        body = _section(item, tables, studies, pictures)
        if body:
            sections.append(
                f'<section id="{item.name}">\n<h2>{html.escape(_heading(item))}</h2>\n{body}\n</section>'
            )
            links.append((item.name, _short(item)))
    if checks:
        body = f"{_plain_table(_check_rows(checks))}\n{_paragraph(CHECKS_NOTE)}"
        sections.append(f'<section id="checks">\n<h2>{CHECKS_TITLE}</h2>\n{body}\n</section>')
        links.append(("checks", "Conditions"))
    nav = "\n".join(f'<a href="#{name}">{html.escape(label)}</a>' for name, label in links)
    made = " · ".join(f"{html.escape(name)} {html.escape(str(value))}" for name, value in facts.items())
    introduction = (
        f"The numbers of {PAPER['source']} beside those of this program, each from a run of its own."
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_TITLE}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n<h1>{_TITLE}</h1>\n"
        f'{_paragraph(f"{introduction} {_LEGEND}")}\n<p class="pale">{made}</p>\n<nav>\n{nav}\n</nav>\n'
        + "\n".join(sections)
        + "\n</body>\n</html>\n"
    )


_SHORT = {
    "work": "Work",
    "seeds": "Other surfaces",
    "inexact": "Few CG iterations",
    "selfaffine": "Self-affine surfaces",
    "kappa": "Contact share",
    "beyond": "Larger grids",
}
_TITLE = "A full multigrid method for elastic contact: tables and figures from real runs"
_LEGEND = (
    "In the tables our number stands above, the paper's below it in grey; what differs noticeably (by "
    f"{ITERATIONS} iterations, or by more than {SHARE:.0%}) is set in orange. In brackets: work units."
)


def _short(item):
    return _SHORT.get(item.name) or _heading(item).partition(":")[0]


def _section(item, tables, studies, pictures):
    if item.name in tables:
        found = entries(item.name, tables[item.name])
        return f"{_paired_table(found)}\n{_paragraph(_comment(item, found))}"
    if item.name in studies:
        data = studies[item.name]
        return f"{_plain_table(_study_rows(data))}\n{_paragraph(_study_comment(item, data))}"
    if item.name in pictures:
        data = base64.b64encode(pictures[item.name]).decode()
        picture = f'<img alt="{html.escape(item.title)}" src="data:image/png;base64,{data}">'
        return f"<figure>\n{picture}\n</figure>\n{_paragraph(item.note)}"
    return ""


def _paragraph(content):
    return f"<p>{html.escape(content)}</p>" if content else ""


def _paired_table(found):
    columns = list(dict.fromkeys(entry.column for entry in found))
    cells = {(entry.row, entry.column): entry for entry in found}
    lines = ["<tr><th>grid</th>" + "".join(f"<th>{html.escape(column)}</th>" for column in columns) + "</tr>"]
    for row in dict.fromkeys(entry.row for entry in found):
        line = [f"<td>{row}</td>"]
        for column in columns:
            entry = cells.get((row, column))
            if entry is None:
                line.append("<td></td>")
                continue
            mark = ' class="off"' if entry.noticeable else ""
            line.append(f"<td{mark}>{show(entry.ours)}<small>{show(entry.paper)}</small></td>")
        lines.append(f"<tr>{''.join(line)}</tr>")
    return '<div class="scroll"><table>\n' + "\n".join(lines) + "\n</table></div>"


def _plain_table(rows):
    if not rows:
        return ""
    lines = ["<tr>" + "".join(f"<th>{html.escape(name)}</th>" for name in rows[0]) + "</tr>"]
    for row in rows:
        cells = "".join(f"<td>{html.escape('' if v is None else format(v))}</td>" for v in row.values())
        lines.append(f"<tr>{cells}</tr>")
    return '<div class="scroll"><table>\n' + "\n".join(lines) + "\n</table></div>"
