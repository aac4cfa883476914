"""What the report says of the paper's numbers."""

import pytest

from app.paper import report
from app.paper.report import Entry


@pytest.mark.parametrize(
    ("paper", "ours", "difference"),
    [
        ([9, 35], [9, 35.4], "+0 (+1%)"),
        ([7, 24], [8, 27], "+1 (+12%)"),
        ([20, 200], [18, 190], "-2 (-5%)"),
        ([9, 0.19], [9, 0.204], "+0 (+0.01)"),
        ([9, 0.19], [9, 0.25], "+0 (+0.06)"),
        (45.29, 45.06, "-1%"),
        (3.70, 4.18, "+13%"),
        (None, [21, 126], "one diverged"),
        (None, None, ""),
    ],
)
def test_differences(paper, ours, difference):
    assert Entry("32 × 32", "V(1,1)", paper, ours).difference() == difference


def test_summary_counts_equal_entries():
    same, other = Entry("a", "b", [9, 35], [9, 35.4]), Entry("c", "d", [9, 35], [5, 35])
    assert report.summarize([same, other]) == "2 entries, 1 of them equal in all digits printed."


def test_numbers_are_written_as_in_the_paper():
    assert [report.format_entry(v) for v in ([9, 0.194], [9, 35.4375], [5, 110], 45.286, None)] == [
        "9 (0.19)", "9 (35)", "5 (110)", "45.29", "diverged",
    ]  # fmt: skip
