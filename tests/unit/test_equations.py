"""docs/equations.md says where the paper is in the code."""

import re

import equations
import pytest

ROWS = list(equations.rows(equations.TABLE.read_text(encoding="utf-8")))
MARKS = [row.words[2:] for row in ROWS if row.words.startswith(("# Sec.", "# ("))]
COMMENTS = [
    line.split("# ", 1)[1]
    for source in (equations.ROOT / "app").rglob("*.py")
    for line in source.read_text(encoding="utf-8").splitlines()
    if "# " in line
]


def test_every_line_of_the_table_is_a_row_that_is_understood():
    lines = equations.TABLE.read_text(encoding="utf-8").splitlines()
    links = [line for line in lines if line.startswith("|") and "](../app" in line]
    assert len(links) == len(ROWS) > 40


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.paper}-{row.name}")
def test_row_names_the_line_that_carries_its_words(row):
    assert row.line == row.found_in(), "python tests/equations.py writes the numbers anew"


@pytest.mark.parametrize(
    "wanted",
    [f"(2.{k})" for k in range(1, 12)]
    + ["Sec. 3", "(4.1)", "(5.1)", "(6.1)", "(6.2)"]
    + [f"Sec. 4.1, {k}" for k in ("1", "2", "3", "(4.a)", "(4.b)", "5", "6")]
    + [f"Sec. 4.2, {k}" for k in range(1, 7)]
    + [f"formula {k}" for k in (1, 2, 3)]
    + [f"Sec. 4.3, {k}" for k in ("1", "2", "(3.a)", "(3.b)", "4")]
    + ["Sec. 4.4"],
)
def test_table_has_the_paper(wanted):
    assert any(wanted in row.paper for row in ROWS)


@pytest.mark.parametrize("mark", MARKS)
def test_each_number_stands_once_alone_in_its_comment(mark):
    """Equations and steps, in the paper's spelling: grep finds the line that does it, and no other one."""
    assert [text for text in COMMENTS if re.search(rf"(?<!\w){re.escape(mark)}", text)] == [mark]


def test_no_number_is_a_comment_without_a_row():
    numbers = [comment for comment in COMMENTS if re.fullmatch(r"(Sec\. 4\S* .*|\(\d\.\w+\))", comment)]
    assert sorted(numbers) == sorted(MARKS)


def test_a_row_that_is_wrong_is_noticed():
    row = equations.Row("(2.7)", "app/contact/state.py", 1, "Pressed.compute_displacement", "(9.9)")
    with pytest.raises(LookupError, match=re.escape("does not say '(9.9)'")):
        row.found_in()
    with pytest.raises(LookupError, match="has no ContactState.nothing"):
        equations.Row("(2.7)", row.path, 1, "ContactState.nothing", "(2.7)").found_in()


def test_numbers_are_written_anew():
    row = ROWS[0]
    old = f"| (1) | a | [{row.path}:1](../{row.path}#L1) | `{row.name}` | `{row.words}` |\n"
    assert f"{row.path}:{row.line}](../{row.path}#L{row.line})" in equations.renumbered("text\n" + old)
