"""What happened, iteration by iteration, and how it ended."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from app.base.errors import format_distinct, format_exact
from app.contact.grid_errors import UNKNOWN, GridErrors


class Listener:
    """Hears of the iteration while it runs; called on the ranks that take part in a grid."""

    def begin(self, settings):
        """Hear of a solve, on all ranks, and the settings of its method: ``settings.rtol`` is -lcp_rtol."""

    def start(self, state, level):
        """Hear of a grid, with the contact set it starts from in ``state.contact``; it may be empty."""

    def iteration(self, entry, state):
        """Hear of an active set iteration: its entry in the history, and the state after it.

        Of the state ``grid``, ``contact`` and ``p`` hold with every method; the default method of periodic patches,
        whose unknown is the displacement, has the approach in the entry only, and no ``u`` before the end.
        """

    def end(self):
        """Hear that all is over."""


class Monitor(Listener):
    """-lcp_monitor: print a line per active set iteration, and a header for every grid."""

    HEADER = "level   it inner   contact   added dropped   residual    work       load [N]  approach [mm]  time [s]"
    say = staticmethod(partial(print, flush=True))

    def __init__(self):
        self.end()

    def end(self):
        """Begin again with the next solve."""
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
    """One entry per active set iteration on any grid, and who wants to hear of it.

    Complete on rank 0; the others miss grids and windows that they have no part in.
    """

    listeners: list = field(default_factory=list)
    entries: list = field(default_factory=list)

    def start(self, state, solver):
        """Begin a grid. Not collective."""
        self._started, self._iteration, self._work = time.perf_counter(), 0, solver.work_units
        for listener in self.listeners:
            listener.start(state, solver.level)

    def add(self, state, solver, update, inner):
        """Record an iteration: update of the contact set, inner iterations. Collective."""
        self._iteration += 1
        self._work, before = solver.work_units, self._work
        work, seconds = self._work - before, time.perf_counter() - self._started
        self.record(entry(state, solver.level, self._iteration, update, inner, work, seconds), state)

    def record(self, entry, state):
        """Record an iteration that somebody else has described. Not collective."""
        self.entries.append(entry)
        for listener in self.listeners:
            listener.iteration(entry, state)

    def stagnates(self):
        """Return whether the last iteration has not halved the residual. Not collective."""
        if self._iteration < 2:
            return False
        before, now = (entry["residual"] for entry in self.entries[-2:])
        return now > before / 2

    def columns(self):
        """Return the entries as name -> list. Not collective."""
        return (
            {name: [entry[name] for entry in self.entries] for name in self.entries[0]}
            if self.entries
            else {}
        )


def entry(state, level, iteration, update, inner, work, seconds):
    """Entry of an iteration: its inner iterations and work units, seconds since the grid began. Collective."""
    return {
        "level": level,
        "iteration": iteration,
        "contact_cells": update.cells,
        "added_cells": update.added,
        "dropped_cells": update.released,
        "changed_cells": update.changed,
        "residual": update.residual / state.distance.norm(),
        "inner_iterations": inner,
        "work_units": work,
        "load": update.load if update.load == update.load else state.load,
        "approach": update.approach if update.approach == update.approach else state.approach,
        "seconds": seconds,
    }


class Outcome(NamedTuple):
    """How the iteration on one grid ended; the same on all ranks that took part."""

    converged: bool
    reason: str
    iterations: int = 0
    residual: float = 0.0  # ||r|| / ||h||, eq. (5.1)
    discretisation_error: float = float("nan")  # of the pressure (rms), relative, estimated from two grids
    grid_errors: GridErrors = UNKNOWN
    fallbacks: int = 0  # grids, this one and coarser, on which the safeguard or the root search took over
    to_rounding: bool = False  # the iteration has done what can be done

    def if_proved(self, bound, allowed):
        """Return this outcome, not converged if the error bound that is proved is more than is allowed."""
        if not self.converged or bound <= allowed:
            return self
        advice = (
            "rounding allows no more"
            if self.to_rounding
            else "a smaller -lcp_rtol or the default method is more accurate"
        )
        proved, asked = format_distinct(bound, allowed, 2), format_exact(allowed)
        doubt = f"the pressure is proved to {proved} only (-lcp_error_bound {asked}); {advice}"
        return self._replace(converged=False, reason=f"{self.reason}, but {doubt}")

    def add_fallbacks(self, coarser):
        """Return this outcome with the fallbacks of that of the coarser grids, if there is one, added."""
        return self._replace(fallbacks=coarser.fallbacks + self.fallbacks) if coarser else self

    def after(self, first):
        """Return this outcome with the iterations of `first`, of which it is the continuation, added."""
        return self._replace(
            iterations=first.iterations + self.iterations,
            fallbacks=first.fallbacks + self.fallbacks,
        )
