"""What the report says of the paper's numbers."""

import pytest

from app.paper import report
from app.paper.report import Entry


@pytest.mark.parametrize(
    ("paper", "ours", "difference", "noticeable"),
    [
        ([9, 35], [9, 35.4], "+0 (+1%)", False),
        ([7, 24], [8, 27], "+1 (+12%)", True),
        ([20, 200], [18, 190], "-2 (-5%)", True),
        ([9, 0.19], [9, 0.204], "+0 (+0.01)", False),
        ([9, 0.19], [9, 0.25], "+0 (+0.06)", True),
        (45.29, 45.06, "-1%", False),
        (3.70, 4.18, "+13%", True),
        (None, [21, 126], "one diverged", True),
        (None, None, "", False),
    ],
)
def test_differences(paper, ours, difference, noticeable):
    entry = Entry("32 × 32", "V(1,1)", paper, ours)
    assert (entry.difference(), entry.noticeable) == (difference, noticeable)


def test_verdict_names_what_differs():
    same, other = Entry("a", "b", [9, 35], [9, 35.4]), Entry("c", "d", [9, 35], [5, 35])
    assert (
        report.summarize([same])
        == "1 entries, 1 of them equal in all digits printed; no noticeable difference."
    )
    assert report.summarize([same, other]).endswith("noticeably different: c d.")


def test_numbers_are_written_as_in_the_paper():
    assert [report.format_entry(v) for v in ([9, 0.194], [9, 35.4375], [5, 110], 45.286, None)] == [
        "9 (0.19)", "9 (35)", "5 (110)", "45.29", "diverged",
    ]  # fmt: skip
