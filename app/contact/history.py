"""History of a solve, its listeners, and its outcome."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from app.base.errors import format_distinct, format_exact
from app.base.numba_cache import clock
from app.contact.grid_errors import UNKNOWN, GridErrors


class Listener:
    """Base class of listeners, which a solve calls on each grid's ranks."""

    def begin(self, settings: Any) -> None:
        """Handle a solve's start on all ranks; ``settings.rtol`` is -lcp_rtol."""

    def start(self, state: Any, level: int) -> None:
        """Handle a grid's start; ``state.contact`` may be empty."""

    def iteration(self, entry: dict[str, Any], state: Any) -> None:
        """Handle an active set iteration: its history entry and the state.

        The state always has ``grid``, ``contact`` and ``p``. With the default method of periodic patches, it has no
        ``u`` before the end, and only the entry has the approach. With dilute contact, its fields are made when they
        are first used, and they take memory for all cells.
        """

    def end(self) -> None:
        """Handle the end of a solve."""


class Monitor(Listener):
    """Listener printing a line per active set iteration (-lcp_monitor)."""

    HEADER = "level   it inner   contact   added dropped   residual    work       load [N]  approach [mm]  time [s]"
    say = staticmethod(partial(print, flush=True))

    def __init__(self):
        self.end()

    def end(self):
        """Reset the header and the work printed, for the next solve."""
        self._level, self._work = None, 0.0

    def iteration(self, entry, state):
        """Print an entry of the history."""
        if entry["level"] != self._level:
            self.say(self.HEADER)
            self._level = entry["level"]
        self._work += entry["work_units"]
        self.say(
            f"{entry['level']:5d} {entry['iteration']:4d} {entry['inner_iterations']:5d} {entry['contact_cells']:9d} "
            f"{entry['added_cells']:7d} {entry['dropped_cells']:7d} {entry['residual']:10.3e} {self._work:7.2f} "
            f"{entry['load']:#14.8g} {entry['approach']:#14.8g} {entry['seconds']:9.3f}"
        )


@dataclass
class History:
    """Record of all active set iterations, which also calls the listeners.

    There is one entry for each iteration on any grid. The record is complete on rank 0. On another rank it lacks the
    grids and windows of which this rank has no rows.
    """

    listeners: list[Listener] = field(default_factory=list)
    entries: list[dict[str, Any]] = field(default_factory=list)

    def start(self, state, solver):
        """Start a grid's record, and call the listeners."""
        self._started, self._iteration, self._work = clock(), state.iterations_before, solver.work_units
        fields = self.listeners and state.fields()
        for listener in self.listeners:
            listener.start(fields, solver.level)

    def add(self, state, solver, update, inner):
        """Record an iteration: its `Update` and inner iterations. Collective."""
        self._iteration += 1
        self._work, before = solver.work_units, self._work
        work, seconds = self._work - before, clock() - self._started
        self.record(make_entry(state, solver.level, self._iteration, update, inner, work, seconds), state)

    def record(self, entry, state):
        """Append an iteration's entry, and call the listeners."""
        self.entries.append(entry)
        fields = self.listeners and state.fields()
        for listener in self.listeners:
            listener.iteration(entry, fields)

    def stagnates(self):
        """Return true unless the last iteration halved the residual."""
        if self._iteration < 2:
            return False
        before, now = (entry["residual"] for entry in self.entries[-2:])
        return now > before / 2

    def columns(self):
        """Return the entries as a dict of columns, each a list."""
        names = self.entries[0] if self.entries else ()
        return {name: [entry[name] for entry in self.entries] for name in names}


def make_entry(state, level, iteration, update, inner, work, seconds):
    """Return an active set iteration's history entry. Collective."""
    return {
        "level": level,
        "iteration": iteration,
        "contact_cells": update.cells,
        "added_cells": update.added,
        "dropped_cells": update.released,
        "changed_cells": update.changed,
        "residual": update.residual / state.h_norm,
        "inner_iterations": inner,
        "work_units": work,
        "load": update.load if update.load == update.load else state.load,
        "approach": update.approach if update.approach == update.approach else state.approach,
        "seconds": seconds,
    }


class Outcome(NamedTuple):
    """Result of the iteration on one grid; the same on its ranks."""

    converged: bool
    reason: str
    iterations: int = 0
    residual: float = 0.0  # ||r|| / ||h||, of the stopping test
    discretisation_error: float = float("nan")  # relative rms error of the pressure, estimated from two grids
    grid_errors: GridErrors = UNKNOWN
    fallbacks: int = 0  # number of grids that needed the safeguard or the root search, coarser ones included
    to_rounding: bool = False  # the residual is as small as rounding allows

    def require_bound(self, bound, allowed):
        """Return this outcome, not converged if the proved `bound` exceeds `allowed`."""
        if not self.converged or bound <= allowed:
            return self
        smaller = "a smaller -lcp_rtol or the default method is more accurate"
        advice = "rounding allows no more" if self.to_rounding else smaller
        proved, asked = format_distinct(bound, allowed, 2), format_exact(allowed)
        doubt = f"the pressure is proved to {proved} only (-lcp_error_bound {asked}); {advice}"
        return self._replace(converged=False, reason=f"{self.reason}, but {doubt}")

    def after(self, first):
        """Return this outcome, with iterations and fallbacks of an earlier one added."""
        iterations, fallbacks = first.iterations + self.iterations, first.fallbacks + self.fallbacks
        return self._replace(iterations=iterations, fallbacks=fallbacks)
