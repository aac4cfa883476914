"""Examples of docs/extending.md and CONTRIBUTING.md, which work from their folder as a user's own files do."""

import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


@pytest.fixture(autouse=True)
def folder(monkeypatch):
    """Work in the folder of the examples, and find them there."""
    monkeypatch.chdir(HERE)
    monkeypatch.syspath_prepend(HERE)
    yield HERE
    for path in HERE.glob("*.py"):
        sys.modules.pop(path.stem, None)
