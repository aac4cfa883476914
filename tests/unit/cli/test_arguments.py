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
@pytest.mark.parametrize(
    ("rank", "size", "argv", "words", "refused"),
    [
        (0, 2, None, [], True),
        (1, 2, None, [], True),
        (0, 1, None, [], False),
        (0, 2, [], [], False),
        (1, 2, None, ["--help"], False),
    ],
)
def test_commands_start_on_one_rank_only(launcher, rank, size, argv, words, refused, monkeypatch, capsys):
    """A script may call them on one of its ranks."""
    main = import_module("app.report").main
    parser, wait = mock.Mock(side_effect=InputError("parsed")), mock.Mock()
    monkeypatch.setattr(import_module("app.cli.report"), "Parser", parser)
    monkeypatch.setattr("time.sleep", wait)
    monkeypatch.setenv(f"{launcher}_SIZE", str(size))
    monkeypatch.setenv(f"{launcher}_RANK", str(rank))
    monkeypatch.setattr("sys.argv", ["report", *words])
    assert main(argv) == 2
    refusal = f"mpiexec -n {size}: this command runs on one rank; start it without mpiexec"
    assert capsys.readouterr().err == f"error: {refusal if refused else 'parsed'}\n"
    assert parser.called == (not refused)
