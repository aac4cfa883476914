"""Numbers that an iteration reads from a contact state."""

from math import sqrt
from typing import NamedTuple


class Update(NamedTuple):
    """Result of updating the contact set, on all ranks; unknown numbers are NaN."""

    cells: int  # number of cells in the new set
    added: int
    released: int  # number of cells released, without those that entered again
    residual: float  # ||h + u||_2 over the new set [mm]
    h_on_contact: float = float("nan")  # ||h||_2 over the new set [mm]
    load: float = float("nan")  # [N]
    approach: float = float("nan")  # [mm]; if NaN, the approach is that of the state
    moves: float = float("inf")  # approximate norm of the change of u by the update [mm]; infinite: unknown

    @property
    def changed(self):
        """Number of cells added or released."""
        return self.added + self.released

    def after(self, first):
        """Return this update with the changes of an earlier update added."""
        return self._replace(added=first.added + self.added, released=first.released + self.released)


class Gaps(NamedTuple):
    """Sums over the cells' gaps, NaN if not computed."""

    cells: int
    squares: float  # sum of (h + u)^2 [mm2]
    total: float  # sum of h + u [mm]
    h: float = float("nan")  # ||h||_2 [mm]
    load: float = float("nan")  # load of all cells of the grid [N]

    @property
    def residual(self):
        """Norm ||h + u||_2 of the gaps [mm]."""
        return sqrt(self.squares)

    @property
    def rms(self):
        """Root mean square gap [mm]; 0 without cells."""
        return sqrt(self.squares / max(self.cells, 1))

    @property
    def mean(self):
        """Mean of the gaps h + u [mm]; 0 without cells."""
        return float(self.total / max(self.cells, 1))
