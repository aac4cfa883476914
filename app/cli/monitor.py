"""Progress bar of a solve."""

import math
import sys

from app.contact.history import Listener


def make_listeners():
    """Return listeners: a list with a progress bar.

    The list is empty without a terminal, and on all ranks but rank 0.
    """
    from app.base.mpi import MPI

    return [Progress()] if MPI.COMM_WORLD.rank == 0 and sys.stderr.isatty() else []


class Progress(Listener):
    """Progress bar, from residual 1 to the tolerance."""

    def __init__(self):
        self._bar = None

    def begin(self, settings):
        """Read the tolerance, and whether -lcp_monitor replaces the bar."""
        self._rtol, self._shown = settings.rtol, not settings.monitor

    def start(self, state, level):
        """Show the bar."""
        if not self._shown:
            return
        from tqdm import tqdm

        form = "{desc} {bar} {postfix} [{elapsed}]"
        self._bar = self._bar or tqdm(total=100, desc="solving", leave=False, bar_format=form, delay=1)

    def end(self):
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()
        self._bar = None

    def iteration(self, entry, state):
        """Show residual and contact cells of an iteration."""
        if not self._shown:
            return
        residual = max(self._rtol, min(1.0, entry["residual"]))  # in this order NaN becomes 1
        self._bar.n = round(100 * math.log(residual) / math.log(self._rtol))
        self._bar.set_description(f"level {entry['level']}, iteration {entry['iteration']}", refresh=False)
        cells = f"{entry['contact_cells']} cells in contact"
        self._bar.set_postfix_str(f"residual {entry['residual']:.1e}, {cells}")
