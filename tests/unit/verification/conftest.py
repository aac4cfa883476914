"""Checks of the verification."""

import pytest

from app.verification import document
from app.verification.check import Check, Figure


@pytest.fixture
def checks(monkeypatch):
    """Two checks in place of all, of which one fails."""
    good = Check(
        "good", "Good", "Law.", lambda quick: [Figure("order of it", 2.0, 1.5, points=((8, 16), (0.4, 0.1)))]
    )
    bad = Check("bad", "Bad", "Law.", lambda quick: [Figure("error", 1.0, most=0.5), Figure("told", 3.0)])
    monkeypatch.setattr(document, "SECTIONS", {"Analytic solutions": (good, bad)})
    monkeypatch.setattr(document, "CHECKS", {check.name: check for check in (good, bad)})
