"""Tables and figures of the reproduction, and their runs."""

from app.paper.item import nest, plan_grids, solver_run


def test_sizes_end_at_the_largest_grid():
    plan = plan_grids(64, (32, 64, 128), {"a": 2}, lambda n, value: value * n)
    assert plan == {("32", "a"): 64, ("64", "a"): 128}


def test_a_run_has_both_files_and_the_options_that_are_not_none():
    run = solver_run("hertz", "fmg_v11", 32, lcp_beta=0.01, lcp_max_it=None)
    assert [name.rsplit("/", 1)[1] for name in run.files] == ["hertz.opts", "fmg_v11.opts"]
    assert run.options == {"grid": "32", "lcp_beta": "0.01"}


def test_cases_are_nested_by_row_and_column():
    assert nest({("a", "x"): 1, ("a", "y"): 2, ("b", "x"): 3}) == {"a": {"x": 1, "y": 2}, "b": {"x": 3}}
