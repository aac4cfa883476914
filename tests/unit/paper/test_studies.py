"""Statistics of studies."""

from app.paper import studies


def test_spread():
    assert studies.quantiles([3, None, 1, 2, 10]) == [1, 2.5, 10]
    assert studies.quantiles([None]) is None
