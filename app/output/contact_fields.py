"""What a solution and a result file that is read have in common."""

from __future__ import annotations

from numbers import Integral

import numpy as np

from app.errors import InputError, agree, check_alike

# What a Solution calls some attributes of the file.
OF_SOLUTION = {"message": "reason", "iterations": "active_set_iterations", "rtol": "lcp_rtol"}


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
        if (there := OF_SOLUTION.get(name, name)) in known:
            return known[there]
        raise AttributeError(f"this {type(self).__name__.lower()} has no {name}; what it has: .attributes")

    def __dir__(self):
        return [*super().__dir__(), *self.attributes, *OF_SOLUTION]

    def contact_patches(self):
        """Areas of the patches of contact, from large to small [mm2]; the same on all ranks. Collective.

        Cells hang together by faces; on a periodic patch across its sides, too.
        """
        from app.halfspace.connected import connected_sets

        _, cells = connected_sets(self.contact == 1, bool(self.grid.periodic), self.slabs, self.comm)
        return np.sort(cells)[::-1] * self.grid.cell_area

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
        from app.halfspace.reductions import minimum_over, sum_over

        def check():
            if name not in ("pressure", "gap"):
                raise InputError(f"distribution {name!r}: allowed: pressure, gap")
            if not (isinstance(bins, Integral) and bins >= 1):
                raise InputError(f"distribution in {bins!r} bins: allowed: a whole number of at least 1")

        if self.comm is None:
            check()
        else:
            agree(self.comm, check)
            check_alike(self.comm, (name, bins, bool(logarithmic)), "distribution")
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
