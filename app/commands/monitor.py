"""What is shown while the active set iteration runs. Only rank 0 prints: it takes part in all grids."""

from __future__ import annotations

import math
import sys

from app.commands.session import say
from app.contact.history import Listener

_HEADER = (
    "level   it inner   contact   added dropped   residual    work       load [N]  approach [mm]  time [s]"
)


def listeners(monitor):
    """Listeners for the solver: the monitor, if it is wanted; else a bar, if anybody looks. Not collective."""
    from mpi4py import MPI

    if monitor:
        return [Monitor()]
    return [Progress()] if MPI.COMM_WORLD.rank == 0 and sys.stderr.isatty() else []


class Monitor(Listener):
    """-lcp_monitor: a line per active set iteration, the header repeated for every grid."""

    def __init__(self):
        self.end()

    def end(self):
        """Begin again with the next solve."""
        self._level, self._work = None, 0.0

    def iteration(self, entry, state):
        """Print an entry of the history."""
        if entry["level"] != self._level:
            say(_HEADER)
            self._level = entry["level"]
        self._work += entry["work_units"]
        say(
            f"{entry['level']:5d} {entry['iteration']:4d} {entry['inner_iterations']:5d} {entry['contact_cells']:9d} "
            f"{entry['added_cells']:7d} {entry['dropped_cells']:7d} {entry['residual']:10.3e} {self._work:7.2f} "
            f"{entry['load']:#14.8g} {entry['approach']:#14.8g} {entry['seconds']:9.3f}"
        )


class Progress(Listener):
    """A bar on the terminal for each solve: how many of the decades to the wanted residual are done on this grid."""

    def __init__(self):
        self._bar = None

    def begin(self, settings):
        """Hear of the wanted residual; a refinement tightens it from grid to grid."""
        self._rtol = settings.rtol

    def start(self, state, level):
        """Show a bar, if there is none yet."""
        from tqdm import tqdm

        how = "{desc} {bar} {postfix} [{elapsed}]"
        self._bar = self._bar or tqdm(total=100, desc="solving", leave=False, bar_format=how, delay=1)

    def end(self):
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()
        self._bar = None

    def iteration(self, entry, state):
        """Show an entry of the history."""
        residual = max(self._rtol, min(1.0, entry["residual"]))  # in this order NaN is 1
        self._bar.n = round(100 * math.log(residual) / math.log(self._rtol))
        self._bar.set_description(f"level {entry['level']}, iteration {entry['iteration']}", refresh=False)
        self._bar.set_postfix_str(
            f"residual {entry['residual']:.1e}, {entry['contact_cells']} cells in contact"
        )
