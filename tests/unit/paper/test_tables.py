"""How the numbers of the paper's tables are counted."""

from app.paper import tables


def test_counts_of_the_paper():
    outcome = {
        "exit_status": 0, "active_set_iterations": 6, "work_units": 26.25, "inner_iterations": 71,
    }  # fmt: skip
    data = tables.evaluate_methods({("32", "V11"): outcome, ("32", "norm_cg"): outcome})
    assert data == {"32": {"V11": [6, 26.2], "norm_cg": [6, 71]}}
    assert tables.inexact_counts(outcome, 4) == [6, 36]
    assert tables.inexact_counts({**outcome, "exit_status": 3}, 4) is None
