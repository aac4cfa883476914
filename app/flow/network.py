"""Conductances between neighbouring cells, and the sums over their faces."""

import numpy as np

from app.parallel.halo import Halo

ROUNDING = 1e-14  # relative error of a sum of positive numbers


def neighbours(padded):
    """Return the values of the cells before and after each face, across x and across y.

    `padded` is a field with a ghost cell at each end.
    """
    return (padded[1:-1, :-1], padded[1:-1, 1:]), (padded[:-1, 1:-1], padded[1:, 1:-1])


class Network:
    """Faces between open cells, for a pressure drop along x or y.

    Arrays of faces have shapes (local rows, nx + 1) and (local rows + 1, nx): the faces across x, from before the first
    cell to after the last, and those across y. Faces between ranks are on both.

    Parameters
    ----------
    cubes : ndarray of float64, shape (local rows, nx)
        Cube of each cell's gap; 0 in closed cells.
    grid, slabs, comm : Grid, Slabs, mpi4py communicator or None
    along : {"x", "y"}
        Direction of the pressure drop.

    Attributes
    ----------
    conductances : pair of ndarray
        Conductances of the faces; 0 next to closed cells.
    is_open : ndarray of bool, shape (local rows, nx)
    linked : list of bool
        Whether the first, and the last, row of faces lies between rows of two ranks or of two periods.
    """

    def __init__(self, cubes, grid, along, slabs, comm=None):
        self.grid, self.slabs, self.along, self.comm, self._cubes = grid, slabs, along, comm, cubes
        self.is_open, (rows, nx) = cubes > 0, cubes.shape
        repeats_y, self.repeats_x = grid.repeats
        self._has_period = grid.repeats[along == "x"]
        self.halo = Halo(slabs, comm, 1, repeats_y)
        self.linked = [len(ghosts) > 0 for ghosts in self.halo(cubes)]
        self._ends = rows > 0 and slabs.rows.start == 0, rows > 0 and slabs.rows.stop == slabs.ny
        # Each face counts once: a face of two ranks is on the second, a face across the period is the first.
        self._counted = slice(nx + (not self.repeats_x)), slice(rows + (self._ends[1] and not repeats_y))
        side = 0.0 if self._has_period else np.inf  # beyond half a cell the pressure is given
        with np.errstate(divide="ignore"):
            in_x, in_y = (2 / (1 / one + 1 / other) for one, other in neighbours(self.pad(cubes, side, side)))
        self.conductances = in_x * (grid.dy / grid.dx), in_y * (grid.dx / grid.dy)

    def pad(self, field, first=0, last=0):
        """Return a field with a ghost cell at each end. Collective.

        Ghost cells beyond a side that does not repeat are 0, and in the direction of the drop `first` and `last`.
        """
        padded = np.zeros([length + 2 for length in field.shape], field.dtype)
        padded[1:-1, 1:-1] = field
        if self.along == "x":
            padded[:, 0], padded[:, -1] = first, last
        for row, end, value in zip((0, -1), self._ends, (first, last), strict=True):
            if end and self.along == "y":
                padded[row] = value
        if self.repeats_x:
            padded[1:-1, 0], padded[1:-1, -1] = field[:, -1], field[:, 0]
        for row, ghosts in zip((0, -1), self.halo(field), strict=True):
            if len(ghosts):
                padded[row, 1:-1] = ghosts[0]
        return padded

    def drops(self, pressure):
        """Return the pressure drops across the faces. Collective."""
        in_x, in_y = (one - other for one, other in neighbours(self.pad(pressure, 1.0)))
        if self._has_period and self.along == "x":
            in_x[:, [0, -1]] += 1.0
        elif self._has_period:
            in_y[[0, -1]] += np.array(self._ends)[:, None]
        return in_x, in_y

    def fluxes(self, pressure):
        """Return the fluxes through the faces. Collective."""
        return [k * drop for k, drop in zip(self.conductances, self.drops(pressure), strict=True)]

    def excess(self, fluxes):
        """Return the inflow of each cell minus its outflow."""
        in_x, in_y = fluxes
        return (in_x[:, :-1] - in_x[:, 1:]) + (in_y[:-1] - in_y[1:])

    def energy(self, pressure):
        """Return an upper bound of the flow rate, from any pressure. Collective."""
        parts = zip(self.conductances, self.drops(pressure), strict=True)
        return self._sum_faces(k * drop**2 for k, drop in parts) * (1 + ROUNDING)

    def dissipation(self, fluxes):
        """Return the sum of flux^2 / conductance over the faces. Collective."""
        parts = zip(self.conductances, fluxes, strict=True)
        return self._sum_faces(np.divide(f * f, k, out=np.zeros_like(f), where=f != 0) for k, f in parts)

    def rate(self, fluxes):
        """Return the flow rate through the first side. Collective."""
        return self.sum(fluxes[0][:, 0].sum() if self.along == "x" else fluxes[1][0].sum() * self._ends[0])

    def _sum_faces(self, parts):
        in_x, in_y = parts
        return self.sum(in_x[:, self._counted[0]].sum() + in_y[self._counted[1]].sum())

    def sum(self, value):
        """Return a number's sum over the ranks. Collective."""
        return float(sum(self.allgather(value)))

    def allgather(self, value):
        """Return the values of all ranks. Collective."""
        return self.comm.allgather(value) if self.comm else [value]

    def has_conductances_of(self, other):
        """Return whether another network has the same conductances. Collective."""
        differs = not self.grid.doubly_periodic or not np.array_equal(self._cubes, other._cubes)
        return self.sum(differs) == 0

    def linear_pressure(self):
        """Return the pressure that falls evenly from 1 to 0; 0 in closed cells."""
        nx, ny = self.grid.nx, self.grid.ny
        columns, rows = np.arange(nx), np.arange(ny)[self.slabs.rows, None]
        place = (columns + 0.5) / nx if self.along == "x" else (rows + 0.5) / ny
        return np.where(self.is_open, 1 - place, 0.0)

    def diagonal(self):
        """Return the sum of the conductances of each cell's faces, shape (local rows, nx)."""
        in_x, in_y = self.conductances
        return in_x[:, :-1] + in_x[:, 1:] + in_y[:-1] + in_y[1:]

    def tie(self, sets, count):
        """Return the conductances between cells and given pressures, shape (local rows, nx). Collective.

        In each of the `count` sets of a patch that repeats in the direction of the drop, P is known up to a constant.
        So one cell of each set is tied to a pressure that the caller chooses. This changes no flux, because nothing
        flows in or out there. All other cells have 0.
        """
        ties = np.zeros(sets.shape)
        if self._has_period:
            numbers = np.arange(ties.size) + self.slabs.rows.start * self.grid.nx
            first = np.full(count + 1, self.grid.n)
            first[sets.ravel()[::-1]] = numbers[::-1]  # of several assignments the last one counts
            tied = np.isin(numbers, np.min(self.allgather(first), axis=0)[1:]).reshape(sets.shape)
            ties[tied] = self.diagonal()[tied]
        return ties
