"""Preconditioners that go wrong, for ``-pc_type python -pc_python_type faults.X``."""

import os
import shutil
import time
from pathlib import Path

from mpi4py import MPI

from app.base.errors import InputError


class RaisesOnLastRank:
    """Raises in the middle of a solve, on one rank only, while the others go on to the next reduction."""

    def apply(self, pc, x, y):
        """Fail."""
        if MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1:
            raise RuntimeError("this rank has a problem of its own")
        x.copy(y)


class TakesForEver:
    """Tells by a file that the solve has begun, and does not come back."""

    def apply(self, pc, x, y):
        """Wait to be killed."""
        Path(os.environ["SOLVE_HAS_BEGUN"]).touch()
        time.sleep(600)


class RemovesFolder:
    """Takes away the folder of the result while it is being computed."""

    def apply(self, pc, x, y):
        """Copy."""
        shutil.rmtree(os.environ["FOLDER_OF_RESULT"], ignore_errors=True)
        x.copy(y)


class RefusesOnLastRank:
    """Refuses the input in the middle of a solve, on one rank only."""

    error = InputError

    def apply(self, pc, x, y):
        """Fail."""
        if MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1:
            raise self.error("only this rank\nminds")
        x.copy(y)


class HasNoMemoryOnLastRank(RefusesOnLastRank):
    """Runs out of memory likewise."""

    error = MemoryError
