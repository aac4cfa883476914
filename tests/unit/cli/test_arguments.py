"""Exit statuses of shell-style commands."""

import signal
from importlib import import_module
from unittest import mock

import pytest

from app.base.errors import InputError


@pytest.mark.parametrize("name", "convert plot report reproduce subsurface sweep verify xdmf".split())
@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt, 130, ""),
        (InputError("no\nway"), 2, "error: no way\n"),
        (OSError(28, "No space left on device"), 2, "error: [Errno 28] No space left on device\n"),
        (MemoryError("17 GiB"), 2, "error: 17 GiB\n"),
        (InputError("unit= (-surface_unit) is missing"), 2, "error: -surface_unit is missing\n"),
        (
            InputError("by skip=2 (-skip 2, x --skip 2), or nu= (--nu X)"),
            2,
            "error: by -skip 2, x --skip 2, or --nu X\n",
        ),
        (InputError("a=b is no (- option)"), 2, "error: a=b is no (- option)\n"),
    ],
)
def test_commands_have_the_same_exit_statuses(name, error, status, line, monkeypatch, capsys):
    main, before = import_module(f"app.{name}").main, signal.getsignal(signal.SIGTERM)
    command = import_module(main.__module__)
    monkeypatch.setattr(command, "Parser", mock.Mock(side_effect=error))
    assert main([]) == status
    assert capsys.readouterr().err == line
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize("launcher", ["OMPI_COMM_WORLD", "PMI"])
@pytest.mark.parametrize(("rank", "size"), [(0, 2), (1, 2), (0, 1)])
def test_commands_start_on_one_rank_only(launcher, rank, size, monkeypatch, capsys):
    main = import_module("app.report").main
    parser, wait = mock.Mock(side_effect=InputError("parsed")), mock.Mock()
    monkeypatch.setattr(import_module("app.cli.report"), "Parser", parser)
    monkeypatch.setattr("time.sleep", wait)
    monkeypatch.setenv(f"{launcher}_SIZE", str(size))
    monkeypatch.setenv(f"{launcher}_RANK", str(rank))
    assert main([]) == 2
    refusal = f"mpiexec -n {size}: this command runs on one rank; start it without mpiexec"
    assert capsys.readouterr().err == f"error: {refusal if size > 1 else 'parsed'}\n"
    assert parser.called == (size == 1)
