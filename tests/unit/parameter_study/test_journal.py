"""Checkpoint of finished runs."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.parameter_study.journal import Journal


def test_journal_skips_invalid_lines_and_one_that_was_cut_off(tmp_path):
    path = tmp_path / "journal"
    journal = Journal(path)
    journal.add("a", {"load": np.float64(1.5), "residual": float("nan")})
    with pytest.raises(InputError, match="another process"):
        Journal(path, resume=True)
    journal.close()
    with path.open("ab") as file:
        file.write(b'{"n": 2}\n[3]\n4\n\xff\xfe\nnull\n{"key": ["b"]}\n{"key": "b", "lo')
    journal = Journal(path, resume=True)
    journal.add("c", {"load": 2})
    journal.close()
    Journal(path).close()  # drops what is there with its first outcome, not before
    outcomes = Journal(path, resume=True).outcomes
    assert list(outcomes) == ["a", "c"]
    assert outcomes["a"]["load"] == 1.5 and np.isnan(outcomes["a"]["residual"])
    anew = Journal(path)
    assert not anew.outcomes and list(anew.discarded) == ["a", "c"]
    anew.add("d", {})
    anew.close()
    assert list(Journal(path, resume=True).outcomes) == ["d"]
