"""Items of the reproduction."""

from app.paper import report, reproduce


def test_what_does_not_converge_is_no_number_of_the_paper():
    """Status 3 has a result, of which no table prints a digit."""
    trace = {"errors": [9.004, 45.286], "exit_status": 0}
    stopped = {**trace, "exit_status": 3}
    (table4,) = reproduce.select_items(["table4"])
    for outcome, discrete, errors in (trace, 45.29, [9.0, 45.29]), (stopped, None, None):
        data = table4.evaluate({("8", "errors"): outcome, ("8", "discrete"): outcome})
        assert data == {"8": {"errors": errors, "discrete": discrete}}
    assert {report.format_entry(entry.ours) for entry in report.pair_entries("table4", data)} == {"diverged"}
