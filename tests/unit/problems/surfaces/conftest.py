"""Fixtures of tests of measured surfaces."""

import pytest

from .maps import FORMATS


@pytest.fixture
def saved(tmp_path):
    def save(heights, name="s.npy"):
        FORMATS[name](tmp_path / name, heights)
        return str(tmp_path / name)

    return save
