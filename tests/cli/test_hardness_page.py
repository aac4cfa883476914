"""docs/hardness.md: its code runs."""

import pytest
from documents import ROOT, code_blocks, run_blocks


def test_bodies_of_the_page_unload_elastically():
    names = run_blocks(code_blocks((ROOT / "docs" / "hardness.md").read_text(encoding="utf-8")))
    table, loaded = names["table"], names["loaded"]
    assert table["load"][12] == 0 < names["residual"] < table["indentation"][6]
    assert table["approach"][13] == table["approach"][6] < table["approach"][14]
    assert names["again"].pressure == pytest.approx(loaded.pressure, abs=5e-3 * 2000)
    assert names["less"].max_pressure < 2000 == loaded.max_pressure
