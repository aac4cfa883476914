"""Tables of spreadsheets, typesetting systems and languages."""

import codecs
import json

import numpy as np
import pytest

from app import read_surface
from app.base.errors import InputError
from app.problems.surfaces.height_map import open_heights

HEIGHTS = np.array([[0.12, -3.4, 5.6, 1.25], [7.0, 8.5, -9.25, 0.5], [2.5, -1.5, 0.25, 3.75]])


def table(separator, number="{:g}".format, start="", end="\n"):
    return "".join(start + separator.join(map(number, row)) + end for row in HEIGHTS)


def comma(value):
    return f"{value:g}".replace(".", ",")


def minus(sign):
    return lambda value: f"{value:g}".replace("-", sign)


def grouped(mark, point="."):
    """Thousand times the heights, in groups of digits."""
    return lambda value: f"{1000 * value:_.2f}".replace(".", point).replace("_", mark)


LATEX = table(" & ", end=" \\\\\n")
PIPES = table(" | ", start="| ", end=" |\n")
RULE = 4 * "+---" + "+\n"
READ = {
    "UTF-16 without a mark": table("\t").encode("utf-16-le"),
    "UTF-16 of the other order": codecs.BOM_UTF16_BE + table(";", comma).encode("utf-16-be"),
    "UTF-16 of the other order, without a mark": table("\t").encode("utf-16-be"),
    "sep": "sep=;\n" + table(";", comma),
    "sep in quotes": '"sep=,"\r\n' + table(",", end="\r\n"),
    "sep, tab": "\ufeffsep=\t\n" + table("\t", comma),
    "trailing semicolons, CR": table(";", comma, end=";\r"),
    "blanks beside tabs": table("\t", " {:g} ".format),
    "true minus": table(" ", minus("\u2212")),
    "en dash": table(";", minus("\u2013")),
    "en dash of Windows": table(";", minus("\x96")).encode("latin-1"),
    "LaTeX": "\\begin{tabular}{r@{}r S[table-format=1.2] r}\n\\hline\n" + LATEX + "\\hline\n\\end{tabular}\n",
    "LaTeX, booktabs": "\\toprule\n" + LATEX.replace("\\\\\n", "\\\\[2pt] % row\n").rstrip() + "\n\\bottomrule",
    "LaTeX in one line": "\\begin{bmatrix}" + LATEX.replace("\n", " ") + "\\end{bmatrix}",
    "LaTeX, decimal commas": table("&", lambda value: f"${comma(value)}$".replace(",", "{,}"), end="\\\\\\hline\n"),
    "LaTeX, powers": table("\n& ", lambda value: f"${1e3 * value:g}\\times10^{{-3}}$", end="\\\\\n"),
    "Markdown": PIPES,
    "Markdown with a head": "| a | b | c | d |\n|--:|:-:|---|---|\n" + PIPES,
    "Markdown without sides": table(" | ", comma),
    "Markdown with an empty head": "| | | | |\n|---|---|---|---|\n" + PIPES,
    "grid": RULE.join(["", *PIPES.splitlines(keepends=True), ""]),
    "grid with a head": RULE + "| a | b | c | d |\n" + RULE.replace("-", "=") + PIPES + RULE,
    "Org with a head": "|---+---+---+---|\n| a | b | c | d |\n|---+---+---+---|\n" + PIPES,
    "Org": "|---+---+---+---|\n" + PIPES + "|---+---+---+---|\n",
    "JSON": json.dumps(HEIGHTS.tolist()),
    "JSON in many lines": json.dumps(HEIGHTS.tolist(), indent=2),
    "YAML": table(", ", start="- [", end="]\n"),
    "numpy": str(HEIGHTS),
    "numpy, repr": repr(HEIGHTS.astype(np.float32)),
    "Mathematica": "{" + table(", ", "{:g}`5.*^0".format, start="{", end="},\n").rstrip(",\n") + "}",
    "C": "double h[3][4] = {" + table(", ", start="{", end="},\n") + "};",
    "MATLAB": "h = [" + table(" ", end=";\n") + "];",
    "MATLAB, continued": "[" + table(", ...\n ", end="; ") + "]",
    "thousands after narrow spaces": table(";", grouped("\u202f", ",")),
    "thousands after no-break spaces": table("\t", grouped("\u00a0")).encode("latin-1"),
    "thousands in LaTeX": table(" & ", grouped("\\,"), end=" \\\\\n"),
    "thousands in Markdown": table(" | ", grouped("\u00a0"), start="| ", end=" |\n"),
    "no-break spaces between": table("\u00a0", "{:.2f}".format),
    "thousands after apostrophes": table(";", grouped("\u2019")),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_one_table_in_every_notation_is_the_same_map(name, tmp_path):
    content = READ[name]
    (tmp_path / "s.txt").write_bytes(content if isinstance(content, bytes) else content.encode())
    heights = read_surface(tmp_path / "s.txt", unit="mm", spacing=1.0).heights()
    np.testing.assert_allclose(heights, HEIGHTS * (1000 if name.startswith("thousands") else 1), rtol=1e-5)


CELLS = "No Data;0;1.5;1,5;1e-3;1.5e+00;2,5D-3;\u22121;-.5;nan;***;---;#N/A;1,500.5;1\u202f234;1'234".split(
    ";"
)
SPACES = "\u00a0\u2009\u202f"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sep=;\n1,2\n3,4\n", "no line has this separator"),
        (table("\t", grouped(" ")), "blanks group thousands"),
        (
            table("\u00a0", lambda value: f"{abs(100 * value):.0f}"),
            "may group thousands or separate numbers",
        ),
        (
            table(";", lambda value: f"{value:.4f}00").replace("00;", "\u202f00;"),
            "may group thousands or separate",
        ),
        (table(";", comma) + ";;;\n;;;\n", "line 5 has no numbers"),
        (";;;\n" + table(";", comma), "line 1 has no numbers"),
        (table(";", comma, end=";;\n"), "the last column has no numbers"),
        (table(",", start=","), "the first column has no numbers"),
        (
            ",0,1,2,3\n" + "".join(f"{j},{line}\n" for j, line in enumerate(table(",").split())),
            "first row and column",
        ),
        ("| 0 | 1 | 2 | 3 |\n|---|---|---|---|\n" + PIPES, "numbers in the head of a table in Markdown"),
        *((f"| {cell} | b | c | d |\n|--|--|--|--|\n" + PIPES, "numbers in the head") for cell in CELLS),
        (
            "|---+---|\n| 0 | 1 |\n|---+---|\n| 1.5 | 2.5 |\n| 3 | 4 |\n|---+---|\n",
            "numbers in the head of a table",
        ),
        (
            RULE + PIPES.replace("\n", "\n" + RULE.replace("-", "="), 1) + RULE,
            "numbers in the head of a table",
        ),
        *((f"1{a}234{b}2{a}345\n" * 2, "may group thousands") for a in SPACES for b in SPACES),
        *((f"[1{a}234{b}2{a}345]", "may group thousands") for a in SPACES for b in ";,"),
        *((f"{{{{1{a}234, 2{a}345}}, {{3, 4}}}}", "may group thousands") for a in SPACES),
        ("0.123\u2009456\u00a00.234\u2009567\n", "may group thousands"),
        ("1,500 & 2,500 \\\\\n950 & 1,500 \\\\\n", "may begin three decimals or group thousands"),
        ("| 1,500 | 2,500 |\n| 950 | 1,250 |\n", "may begin three decimals or group thousands"),
        ("1,500;2,500\n950;1,250\n", "may begin three decimals or group thousands"),
        *((f"sep={mark}\n1{mark}5\n2{mark}5\n", "must be one of ; , | or a tab") for mark in ".1- "),
        ("[1 2\n3 4\n", "its brackets enclose no matrix"),
        ("[mm]\n1 2\n3 4\n", "'[mm]' is no number; skip the line at the head by skip=1"),
        (
            "[Header]\nWidth=3\n\n1 2\n3 4\n",
            "'[Header]' is no number; skip the 3 lines at the head by skip=3",
        ),
        ("[[1+2j, 2], [3, 4]]", "line 1, entry 1: '1+2j' is no number"),
        ("1.5(2) & 2 \\\\ 3 & 4 \\\\", "line 1, entry 1: '1.5(2)' is no number"),
        (LATEX.replace("-3.4", "\\multicolumn{1}{c}{3}"), "in a LaTeX table is no plain number"),
        (LATEX.replace("\\\\\n7", "\n7"), "has 4 entries, line 1 has 7"),
        (np.array2string(np.arange(5000.0).reshape(50, 100)), "is abbreviated"),
        ("[1, 2,\n 3, 4]", "its lines may be rows or one long row"),
        ("[1 - 2; 3 4]", "'-' is no number"),
        ("[1 2; 3 4]*1e-3", "its brackets enclose no matrix"),
        ("[1 2; 3 4]'", "its brackets enclose no matrix"),
        ("log([[1, 2], [3, 4]])", "is no number"),
        ("[[1, 2], [3]]", "row 2 of the matrix in brackets has 1 numbers, row 1 has 2"),
        ("[[[1, 2], [3, 4]], [[5, 6], [7, 8]]]", "must be one matrix"),
        ('{"z": [[1, 2], [3, 4]]}', "is no number"),
        ("{{1/2, 1}, {2, 3}}", "'1/2' is no number"),
        ("1,234\t987\n12,345\t6\n", "may begin three decimals or group thousands"),
        ("1{,}234 & 987 \\\\\n12{,}345 & 6 \\\\\n", "may begin three decimals or group thousands"),
        ("   1.0e+03 *\n\n    1.2    3.4\n    5.6    7.8\n", "MATLAB's display with a common factor"),
        ("| 1 || 2 || 3\n| 4 || 5 || 6\n", "may separate two cells, or enclose an empty one"),
        ("- 0.5\n- 1.5\n- 2.5\n", "as lists of YAML"),
    ],
)
def test_tables_that_may_be_read_in_two_ways_are_refused_in_one_line(text, message, tmp_path):
    (tmp_path / "s.txt").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_surface(tmp_path / "s.txt", unit="mm", spacing=1.0)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("rule", ["| --- | --- |\n", "|---|---|\n"])
def test_a_first_line_of_dashes_is_a_row_of_missing_points(rule, tmp_path):
    (tmp_path / "s.md").write_text(rule + "| 1 | 2 |\n| 3 | 4 |\n")
    rows = open_heights(tmp_path / "s.md").rows()
    np.testing.assert_array_equal(rows, [[np.nan, np.nan], [1, 2], [3, 4]])
