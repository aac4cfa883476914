"""Methods that solutions and result files share; importable without MPI or numba."""

from __future__ import annotations

from numbers import Integral
from typing import NamedTuple

import numpy as np

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.options.option_table import find_similar_name

# Name in a Solution -> name of the attribute in a file.
ATTRIBUTE_NAMES = {"message": "reason", "iterations": "active_set_iterations", "rtol": "lcp_rtol"}
_MIN_MEAN_VECTOR = 1e-9  # mean length of unit vectors; below, cells lie all around the period


class Patches(NamedTuple):
    """Contact spots by decreasing size, equal on all ranks.

    Spots of one size are ordered by their first cells. Cells are connected by faces, on a periodic patch also across
    its sides.

    Attributes
    ----------
    labels : ndarray of int, shape (rows, nx)
        Of this rank's rows: 0 without contact, k + 1 in spot k (from 0).
    cells : ndarray of int, shape (spots,)
    area, load, max_pressure : ndarray of float64, shape (spots,)
        [mm2], [N], [N/mm2].
    centre_x, centre_y : ndarray of float64, shape (spots,)
        Centre of the area [mm]. Meaningless or NaN for a spot that surrounds a periodic patch.
    """

    labels: np.ndarray
    cells: np.ndarray
    area: np.ndarray
    load: np.ndarray
    max_pressure: np.ndarray
    centre_x: np.ndarray
    centre_y: np.ndarray


class ContactFields:
    """Contact spots, distributions and attributes of solutions and results.

    Subclasses have `pressure`, `gap` and `contact`, shape (rows, nx); `grid`; `slabs` and `comm`, None if this rank
    has all rows; and the numbers in `__repr__`.
    """

    def __repr__(self):
        count = len(self.notes)
        notes = f", {count} note{'s'[: count > 1]}: see .notes" if count else ""
        return (
            f"<{type(self).__name__}: {self.grid.nx} x {self.grid.ny} cells, load {self.load:g} N, approach "
            f"{self.approach:g} mm, {'converged' if self.converged else 'NOT converged'}, error bound "
            f"{self.error_bound:.1g}{notes}>"
        )

    def __getattr__(self, name):
        """Return an attribute by its name in file or `Solution`."""
        # Unpickling asks for names before there are attributes.
        attributes = self.attributes if self.__dict__ and name != "attributes" and name[0] != "_" else {}
        if (key := ATTRIBUTE_NAMES.get(name, name)) in attributes:
            return attributes[key]
        similar = find_similar_name(
            name, [public for public in dir(self) if public[0] != "_"] if attributes else ()
        )
        hint = f"did you mean {similar}?" if similar else "what it has: .attributes"
        raise AttributeError(f"this {type(self).__name__.lower()} has no {name}; {hint}")

    def __dir__(self):
        return {*super().__dir__(), *self.attributes, *ATTRIBUTE_NAMES}

    def patches(self):
        """Return cells, area, load and centre of each contact spot. Collective.

        Returns
        -------
        Patches
        """
        from app.parallel.reductions import minimum_over, sum_over

        grid = self.grid
        unsorted, sizes = self._connected_sets()
        order, number = np.argsort(-sizes, kind="stable"), np.zeros(len(sizes) + 1, unsorted.dtype)
        number[order + 1] = np.arange(1, len(sizes) + 1)
        labels, sizes = number[unsorted], sizes[order]
        j, i = np.nonzero(labels)
        spot, pressure, highest = labels[j, i] - 1, self.pressure[j, i], np.zeros(len(sizes))
        np.maximum.at(highest, spot, pressure)

        def total(values):
            return sum_over(self.comm, np.bincount(spot, values, len(sizes)))

        def centre(positions, start, period):
            if not grid.periodic:
                return total(positions) / sizes
            # Start from the mean direction on the circle; then average the distances from it.
            angle = 2 * np.pi * (positions - start) / period
            x, y = total(np.cos(angle)), total(np.sin(angle))
            mean = np.arctan2(y, x) / (2 * np.pi) * period
            mean[np.hypot(x, y) < _MIN_MEAN_VECTOR * sizes] = np.nan
            distance = positions - start - mean[spot]
            distance -= period * np.round(distance / period)
            return start + (mean + total(distance) / sizes) % period

        return Patches(
            labels,
            sizes,
            sizes * grid.cell_area,
            total(pressure) * grid.cell_area,
            -minimum_over(self.comm, -highest),
            centre(self.x[i], grid.x0, grid.nx * grid.dx),
            centre(self.y[j], grid.y0, grid.ny * grid.dy),
        )

    def contact_patches(self):
        """Return the areas of the contact spots [mm2]. Collective."""
        _, cells = self._connected_sets()
        return np.sort(cells)[::-1] * self.grid.cell_area

    def _connected_sets(self):
        """Return labels and numbers of cells of contact spots. Collective."""
        from app.halfspace.connected_sets import label_connected_sets

        return label_connected_sets(self.contact == 1, bool(self.grid.periodic), self.slabs, self.comm)

    def count_patches(self):
        """Return number of contact spots and largest area. Collective."""
        areas = self.contact_patches()
        return {"contact_patches": len(areas), "largest_patch": float(areas.max(initial=0.0))}

    def distribution(self, name, bins=100, logarithmic=False):
        """Return the distribution of positive pressures in contact, or of positive gaps.

        Collective.

        Parameters
        ----------
        name : str
            "pressure" or "gap".
        bins : int
        logarithmic : bool
            Bins of equal ratio; else of equal width.

        Returns
        -------
        edges : ndarray, shape (bins + 1,), [N/mm2] or [mm]
            From the smallest to the largest value; from half to twice a single value; empty without values.
        density : ndarray, shape (bins,)
            Share of the counted cells per unit; its integral is 1.

        Raises
        ------
        InputError
            If `name` or `bins` is not allowed.
        """
        from app.parallel.reductions import minimum_over, sum_over

        def check():
            if name not in ("pressure", "gap"):
                raise InputError(f"distribution {name!r}: allowed: pressure, gap")
            if not (isinstance(bins, Integral) and bins >= 1):
                raise InputError(f"distribution in {bins!r} bins: allowed: a whole number of at least 1")

        if self.comm is None:
            check()
        else:
            call_collectively(self.comm, check)
            check_equal_on_ranks(self.comm, (name, bins, bool(logarithmic)), "distribution")
        values = getattr(self, name)
        values = values[(self.contact == (name == "pressure")) & (values > 0)]
        low, high = minimum_over(self.comm, [values.min(initial=np.inf), -values.max(initial=0.0)])
        high = -high
        if not high:
            return np.zeros(0), np.zeros(0)
        if high <= low * (1 + 1e-12 * bins):  # narrower bins would have equal edges
            low, high = low / 2, 2 * high
        edges = np.geomspace(low, high, bins + 1) if logarithmic else np.linspace(low, high, bins + 1)
        edges[0], edges[-1] = low, high
        counts = sum_over(self.comm, np.histogram(values, edges)[0])
        return edges, counts / counts.sum() / np.diff(edges)
