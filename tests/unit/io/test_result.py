"""Result files that cannot be read."""

import pytest

from app import read_result
from app.base.errors import InputError


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("result file None: needed: a path", lambda: read_result(None)),
        ("no such file", lambda: read_result("nothing.h5")),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)
