"""Tables and figures of the reproduction, and their runs."""

from app.paper.item import FULL, QUICK, nest, solver_run


def test_sizes_end_at_the_largest_grid():
    assert QUICK.sizes(32, 64, 128) == [32, 64]
    assert FULL.sizes(256, 512) == [256]


def test_a_run_has_both_files_and_the_options_that_are_not_none():
    run = solver_run("hertz", "fmg_v11", 32, lcp_beta=0.01, lcp_max_it=None)
    assert [name.rsplit("/", 1)[1] for name in run.files] == ["hertz.opts", "fmg_v11.opts"]
    assert run.options == {"grid": "32", "lcp_beta": "0.01"}


def test_cases_are_nested_by_row_and_column():
    assert nest({("a", "x"): 1, ("a", "y"): 2, ("b", "x"): 3}) == {"a": {"x": 1, "y": 2}, "b": {"x": 3}}
