"""Simultaneous runs and table rows."""

from app.parameter_study.batch import make_rows, run_all
from app.parameter_study.journal import Journal
from app.parameter_study.run import Run


def execute(tmp_path, runs, resume=True, **how):
    journal = Journal(tmp_path / "journal", resume)
    try:
        return run_all(runs, tmp_path / "work", journal, **how)[0]
    finally:
        journal.close()


def runs_on(*grids, **labels):
    return [Run((), {"grid": grid}, labels) for grid in grids]


def test_resume_skips_answered_runs(tmp_path, performed):
    first = execute(tmp_path, runs_on("8", "crash", "refused"))
    again = execute(tmp_path, runs_on("8", "crash", "refused", "16"))
    assert [call["grid"] for call in performed] == ["8", "crash", "refused", "crash", "refused", "16"]
    assert again[0] == first[0]
    execute(tmp_path, runs_on("8"), resume=False)
    assert len(performed) == 7


def test_equal_runs_are_performed_once(tmp_path, performed):
    outcomes = execute(tmp_path, [*runs_on("8", a=1), *runs_on("8", b=2)], jobs=2)
    assert len(performed) == 1 and outcomes[0] == outcomes[1]


def test_varied_option_keeps_its_column_name():
    (row,) = make_rows([Run(labels={"load": 5})], [{"load": 4.9, "exit_status": 0}])
    assert (row["load"], row["result_load"]) == (5, 4.9)
