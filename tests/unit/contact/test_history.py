"""Listeners, monitor and history of the iterations."""

import pytest
from cases import APPROACH, hertz

from app import ContactSolver, InputError, Listener


class Log(Listener):
    """Records its calls."""

    def __init__(self):
        self.calls = []

    def begin(self, settings):
        self.calls.append(settings.rtol)

    def start(self, state, level):
        self.calls.append("start")

    def iteration(self, entry, state):
        self.calls.append(entry["iteration"])

    def end(self):
        self.calls.append("end")


def test_listeners_receive_every_iteration():
    log = Log()
    with ContactSolver(hertz(12), "norm", {"lcp_rtol": 1e-5}, listeners=[log]) as solver:
        found = solver.solve(approach=APPROACH)
    assert log.calls == [1e-5, "start", *found.history["iteration"], "end"]


def test_listeners_receive_the_end_of_a_refused_solve():
    log = Log()
    with ContactSolver(hertz(12), listeners=[log]) as solver, pytest.raises(InputError):
        solver.solve(load=-1)
    assert log.calls[-1] == "end"


@pytest.mark.parametrize("method", ["norm", None])
def test_monitor_prints_the_history_of_each_solve(method, capsys):
    """From Python the option is the only way to switch it on."""
    with ContactSolver(hertz(12), method, options={"lcp_monitor": True}) as solver:
        for _ in range(2):
            history = solver.solve(approach=APPROACH).history
            rows = [line.split() for line in capsys.readouterr().out.splitlines()]
            assert rows[0][:3] == ["level", "it", "inner"]
            printed = [(row[0], row[1], row[3]) for row in rows if row[0] != "level"]
            columns = (map(str, history[name]) for name in ("level", "iteration", "contact_cells"))
            assert printed == list(zip(*columns, strict=True))
