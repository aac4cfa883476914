"""Standard streams."""

import pytest

from app.cli import streams


@pytest.mark.timeout(20)
@pytest.mark.parametrize("part", ["x", "a=", "a=.", "x= (-", "(-", " "])
def test_errors_are_printed_in_linear_time(part, capsys):
    """A quadratic search takes hours."""
    line = 10**6 * part
    streams.print_error(line)
    assert capsys.readouterr().err == line + "\n"
