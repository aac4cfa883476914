"""app.solve by several ranks against one."""

from functools import cache

import numpy as np
import pytest

from app.output.result import read_result


@pytest.fixture(scope="module")
def one_rank(cli, tmp_path_factory):
    """``one_rank(method, grid)``: the result of one rank."""

    @cache
    def result(method, grid):
        return run(cli, method, grid, None, tmp_path_factory.mktemp("one") / "result.h5")

    return result


def run(cli, method, grid, ranks, where):
    # Few cells on a rank, so that several levels are distributed; double precision to compare digits.
    arguments = ("-grid", grid, "-lcp_cells_per_rank", "32", "-lcp_precision", "double", "-output", where)
    done = cli(*arguments, methods=("hertz", method), ranks=ranks)
    assert done.returncode == 0, done.stderr
    return read_result(where)


@pytest.mark.ranks(2, 3, 4)
@pytest.mark.parametrize("grid", ["64", "52,37"])
@pytest.mark.parametrize("method", ["mg_v11", "fmg_v10", "fast", "fmg_lift"])
def test_any_number_of_ranks_iterates_alike(cli, one_rank, ranks, method, grid, tmp_path):
    one, many = one_rank(method, grid), run(cli, method, grid, ranks, tmp_path / "result.h5")
    assert list(one.history["contact_cells"]) == list(many.history["contact_cells"])
    assert one.attributes["work_units"] == pytest.approx(many.attributes["work_units"])
    np.testing.assert_allclose(many.pressure, one.pressure, rtol=0, atol=1e-10 * one.pressure.max())


@pytest.mark.ranks(2)
@pytest.mark.parametrize("method", ["mg_v10", "fmg_v11", "fast"])
def test_load_on_two_ranks(cli, ranks, method, tmp_path):
    def run(*loading):
        where = tmp_path / "result.h5"
        done = cli("-grid", "96", *loading, "-output", where, methods=("punch", method), ranks=ranks)
        assert done.returncode == 0, done.stderr
        return read_result(where).attributes

    by_approach = run("-approach", "0.1")
    by_load = run("-load", repr(float(by_approach["load"])))
    assert by_load["operator_applications"] <= 1.5 * by_approach["operator_applications"]
    assert by_load["load"] == pytest.approx(by_approach["load"], rel=1e-12)
    assert by_load["approach"] == pytest.approx(0.1, abs=1e-6)
