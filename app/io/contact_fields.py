"""What a solution and a result file that is read have in common."""

from __future__ import annotations

from numbers import Integral
from typing import NamedTuple

import numpy as np

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.options.option_table import find_similar_name

# What a Solution calls some attributes of the file.
ATTRIBUTE_NAMES = {"message": "reason", "iterations": "active_set_iterations", "rtol": "lcp_rtol"}
_ROUNDING = 1e-9  # on average over cells all around a period


class Patches(NamedTuple):
    """Patches of contact from large to small, those of one size by their first cells; the same on all ranks.

    Cells hang together by faces; on a periodic patch across its sides, too.

    Attributes
    ----------
    labels : ndarray of int, shape (rows, nx)
        Of the rows here: 0 where there is no contact; k + 1 in patch k, from 0.
    cells : ndarray of int, shape (patches,)
    area, load, max_pressure : ndarray of float64, shape (patches,)
        [mm2], [N], [N/mm2].
    centre_x, centre_y : ndarray of float64, shape (patches,)
        Of the area [mm]. On a periodic patch of no meaning, or NaN, where one goes all around.
    """

    labels: np.ndarray
    cells: np.ndarray
    area: np.ndarray
    load: np.ndarray
    max_pressure: np.ndarray
    centre_x: np.ndarray
    centre_y: np.ndarray


class ContactFields:
    """Patches and distributions, and a line that says what it is; who only reads a file need not wait for MPI or numba.

    Who derives from it has `pressure`, `gap` and `contact`, shape (rows, nx); `grid`; `slabs` and `comm`, None where
    all rows are here; and the numbers that `__repr__` tells.
    """

    def __repr__(self):
        notes = len(self.notes)
        said = f", {notes} note{'s'[: notes > 1]}: see .notes" if notes else ""
        return (
            f"<{type(self).__name__}: {self.grid.nx} x {self.grid.ny} cells, load {self.load:g} N, approach "
            f"{self.approach:g} mm, {'converged' if self.converged else 'NOT converged'}, error bound "
            f"{self.error_bound:.1g}{said}>"
        )

    def __getattr__(self, name):
        """An attribute of the file, by the name that it has there, or in a `Solution`."""
        # There are none yet while it is unpickled.
        known = self.attributes if self.__dict__ and name != "attributes" and name[0] != "_" else {}
        if (there := ATTRIBUTE_NAMES.get(name, name)) in known:
            return known[there]
        meant = find_similar_name(name, [there for there in dir(self) if there[0] != "_"] if known else ())
        hint = f"did you mean {meant}?" if meant else "what it has: .attributes"
        raise AttributeError(f"this {type(self).__name__.lower()} has no {name}; {hint}")

    def __dir__(self):
        return {*super().__dir__(), *self.attributes, *ATTRIBUTE_NAMES}

    def patches(self):
        """The patches of contact one by one: which cells, how large, under what load, where. Collective.

        Returns
        -------
        Patches
        """
        from app.parallel.reductions import minimum_over, sum_over

        grid = self.grid
        found, sizes = self._connected()
        order, number = np.argsort(-sizes, kind="stable"), np.zeros(len(sizes) + 1, found.dtype)
        number[order + 1] = np.arange(1, len(sizes) + 1)
        labels, sizes = number[found], sizes[order]
        j, i = np.nonzero(labels)
        of, pressure, highest = labels[j, i] - 1, self.pressure[j, i], np.zeros(len(sizes))
        np.maximum.at(highest, of, pressure)

        def total(values):
            return sum_over(self.comm, np.bincount(of, values, len(sizes)))

        def centre(at, first, period):
            if not grid.periodic:
                return total(at) / sizes
            # The mean on the circle, then that of the cells as they are nearest to it.
            turn = 2 * np.pi * (at - first) / period
            x, y = total(np.cos(turn)), total(np.sin(turn))
            near = np.arctan2(y, x) / (2 * np.pi) * period
            near[np.hypot(x, y) < _ROUNDING * sizes] = np.nan
            away = at - first - near[of]
            away -= period * np.round(away / period)
            return first + (near + total(away) / sizes) % period

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
        """Areas of the patches of contact, from large to small [mm2]; the same on all ranks. Collective.

        More about them: `patches`.
        """
        _, cells = self._connected()
        return np.sort(cells)[::-1] * self.grid.cell_area

    def _connected(self):
        """Labels of the patches of contact in the rows here, and their cells. Collective."""
        from app.halfspace.connected_sets import label_connected_sets

        return label_connected_sets(self.contact == 1, bool(self.grid.periodic), self.slabs, self.comm)

    def count_patches(self):
        """Number of patches of contact, and area of the largest [mm2], as results have them. Collective."""
        areas = self.contact_patches()
        return {"contact_patches": len(areas), "largest_patch": float(areas.max(initial=0.0))}

    def distribution(self, name, bins=100, logarithmic=False):
        """Distribution of positive pressures over cells in contact, or of positive gaps over those that are open.

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
            From the smallest to the largest value; from half to twice the value, if it is only one; empty if there
            are none.
        density : ndarray, shape (bins,)
            Share of the cells counted per unit; its integral is 1.

        Raises
        ------
        InputError
            If it is the distribution of something else, or in no bins.
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
        if high <= low * (1 + 1e-12 * bins):  # bins could not be told apart
            low, high = low / 2, 2 * high
        edges = np.geomspace(low, high, bins + 1) if logarithmic else np.linspace(low, high, bins + 1)
        edges[0], edges[-1] = low, high
        counts = sum_over(self.comm, np.histogram(values, edges)[0])
        return edges, counts / counts.sum() / np.diff(edges)
