"""Ends of programs on several ranks."""

import sys

from app.parallel import mpi_abort


def test_an_exception_at_a_prompt_ends_nobody(monkeypatch, capsys):
    class Two:
        size = 2

    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(mpi_abort, "_last_used", mpi_abort._last_used)
    monkeypatch.setattr(mpi_abort, "shutdown_comm", lambda comm: comm)
    monkeypatch.setattr(mpi_abort, "barrier_with_timeout", lambda comm: comm.size < 2)
    monkeypatch.setattr(mpi_abort, "abort_all", lambda status: print("aborted", status))
    mpi_abort.abort_on_exception(Two())
    mpi_abort.abort_on_exception(Two())
    error = ValueError("two\nlines")
    sys.excepthook(ValueError, error, None)
    told = capsys.readouterr()
    assert told.out == "aborted 1\n"
    assert told.err.endswith("error: rank 0: ValueError: two lines; all ranks are ended\n")
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    sys.excepthook(ValueError, error, None)
    assert capsys.readouterr().out == ""
