"""The constants that `python -m benchmarks.techniques` varies exist."""

import pytest

from benchmarks.measure import ROOT
from benchmarks.techniques import FREE, PERIODIC


@pytest.mark.parametrize(
    ("constant", "method"),
    [*((constant, "fast") for constant in FREE), *((constant, "primal") for constant in PERIODIC)],
    ids=str,
)
def test_constant_is_restored_after_a_count(constant, method):
    value, seen = constant.value(method), []
    row = constant.count(lambda options: seen.append(options or constant.value(method)), 2 * value)
    assert row is None and value > 0
    assert seen == [2 * value if constant.module else {constant.name: 2 * value}]
    assert constant.value(method) == value


def test_page_explains_each_constant_as_the_program_does():
    page = (ROOT / "docs/notebook/performance.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    for constant in (*FREE, *PERIODIC):
        assert any(str(constant) in row and f"| {constant.meaning} |" in row for row in rows), constant
