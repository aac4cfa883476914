"""The constants that `python -m benchmarks.devices` varies are there."""

import pytest

from benchmarks.devices import FREE, PERIODIC


@pytest.mark.parametrize(
    ("constant", "method"),
    [*((constant, "fast") for constant in FREE), *((constant, "primal") for constant in PERIODIC)],
    ids=str,
)
def test_each_constant_has_a_number_and_keeps_it(constant, method):
    value, seen = constant.value(method), []
    row = constant.count(lambda options: seen.append(options or constant.value(method)), 2 * value)
    assert row is None and value > 0
    assert seen == [2 * value if constant.module else {constant.name: 2 * value}]
    assert constant.value(method) == value
