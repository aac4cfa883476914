"""Methods that solutions and result files share.

The module can be imported without MPI or numba.
"""

from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from app.base import views
from app.base.errors import InputError, call_collectively, check_equal_on_ranks, warn_caller
from app.base.quantities import QUANTITIES
from app.base.types import Axes, DataFrame, Dataset, Figure, Floats
from app.base.units import format_quantity
from app.flow.results import FLOW_FIELDS, FLOW_NUMBERS, Flow
from app.halfspace.grid import Grid
from app.io.frames import to_dataframe, to_xarray
from app.options.option_table import USUAL_NAMES, find_similar_name
from app.problems.residual_surface import ResidualSurface

STIFFNESS_NUMBERS = (  # None in a Solution unless requested
    "stiffness", "unloading_stiffness", "conductance_width", "electrical_conductance", "thermal_conductance",
)  # fmt: skip
# Name in a Solution -> name of the attribute in a file.
ATTRIBUTE_NAMES = {"message": "reason", "iterations": "active_set_iterations", "rtol": "lcp_rtol"}
PATCH_UNITS = {"area": "mm2", "load": "N", "max_pressure": "N/mm2", "centre_x": "mm", "centre_y": "mm"}
# Word that may be meant in an attribute's name -> word in the name.
_USUAL_WORDS = {"resistance": "conductance", "peak": "max", "maximum": "max", "average": "mean"}
# Other names than those of fields and physical numbers that tab completion shows.
_SHOWN = {"converged", "notes", "error_bound", "iterations", "message"}
_HIDDEN = {
    "comm",
    "computed",
    "slabs",
    "traffic",
    "distance",
    "rtol",
    "problem",
    "options",
    "fallbacks",
    "inner_iterations",
}
_MAX_SHOWN = 12  # contact spots that are printed
_MIN_MEAN_VECTOR = 1e-9  # length of the mean of unit vectors; if it is less, cells lie all around the period


def find_similar_attribute(name, known):
    """Return the known attribute that `name` may mean, or None.

    Its words may be misspelt, in another order, incomplete, or other words for the same.

    Examples
    --------
    >>> names = "max_pressure", "contact_area", "conductance_width", "electrical_conductance"
    >>> [find_similar_attribute(name, names) for name in ("peak_pressure", "area", "resistance", "x")]
    ['max_pressure', 'contact_area', 'electrical_conductance', None]
    """
    usual = find_similar_name(name, known) if name in USUAL_NAMES else None
    words = [_USUAL_WORDS.get(word, word) for word in name.lower().split("_")]
    whole = [other for other in known if set(words) <= set(other.split("_"))]
    whole.sort(key=lambda other: (not other.endswith(words[-1]), len(other)))
    return usual or next(iter(whole), None) or find_similar_name("_".join(words), known)


class Patches(NamedTuple):
    """Contact spots by decreasing size, on all ranks.

    A contact spot is a set of cells in contact that are connected by sides, on a periodic patch also across the sides
    of the patch. Spots of one size are ordered by their first cells.

    Attributes
    ----------
    labels : ndarray of int, shape (rows, nx)
        Label of each cell in this rank's rows: 0 without contact, k + 1 in spot k; the first spot has k = 0.
    cells : ndarray of int, shape (spots,)
        Number of cells of each spot.
    area, load, max_pressure : ndarray of float64, shape (spots,)
        Area [mm2], load [N] and highest pressure [N/mm2] of each spot.
    centre_x, centre_y : ndarray of float64, shape (spots,)
        Centroid of each spot [mm]. Meaningless or NaN for a spot that extends over a whole period.
    grid : Grid
    """

    labels: np.ndarray
    cells: np.ndarray
    area: Floats
    load: Floats
    max_pressure: Floats
    centre_x: Floats
    centre_y: Floats
    grid: Grid | None = None

    def to_dataframe(self) -> DataFrame:
        """Return a pandas.DataFrame with a row for each spot.

        The units are in its ``attrs["units"]``.
        """
        columns = {name: getattr(self, name) for name in ("cells", *PATCH_UNITS)}
        labels = {"label": np.arange(1, len(self.cells) + 1)}
        return to_dataframe(labels | columns, "label", PATCH_UNITS)

    def __repr__(self):
        from tabulate import tabulate  # loads slowly

        names = "cells", *PATCH_UNITS
        columns = zip(*(getattr(self, name)[:_MAX_SHOWN].tolist() for name in names), strict=True)
        rows = [dict(zip(names, values, strict=True)) for values in columns]
        count = len(self.cells)
        more = f"... {count - _MAX_SHOWN} more\n" if count > _MAX_SHOWN else ""
        table = tabulate(rows, headers="keys", floatfmt=".4g") + "\n" if rows else ""
        return f"{count} contact spot{'s'[: count != 1]}; mm2, N, N/mm2, mm\n{table}{more}".rstrip()

    def _repr_html_(self):
        return views.load().patches_html(self)


class ContactFields:
    """Contact spots, distributions and attributes of solutions and results.

    Subclasses have the arrays `pressure`, `gap` and `contact`, shape (rows, nx), a `grid`, and the numbers that
    `__repr__` shows. They also have `slabs` and `comm`, which are None if this rank has all rows.
    """

    def __repr__(self):
        count = len(self.notes)
        notes = f", {count} note{'s'[: count > 1]}: see .notes" if count else ""
        load, approach = format_quantity(self.load, "N", 6), format_quantity(self.approach, "mm", 6)
        return (
            f"<{type(self).__name__}: {self.grid.nx} x {self.grid.ny} cells, load {load}, approach "
            f"{approach}, {'converged' if self.converged else 'NOT converged'}, error bound "
            f"{self.error_bound:.1g}{notes}>"
        )

    def _repr_html_(self):
        return views.load().solution_html(self)

    def summary(self) -> str:
        """Return the text app.solve prints on a solution. Collective."""
        return views.load().summarize(self)

    def plot(self, name: str | None = None, ax: Axes | None = None) -> tuple[Figure, Any]:
        """Draw a picture of these fields, chosen by `name`.

        On several ranks, call the method `plot` of ``solution.gather()`` on one rank.

        Parameters
        ----------
        name : str, optional
            summary (the default), contact, pressure, deformation, sections, distributions, spectrum, history; or a
            single panel: displacement, gap, plastic_depth, section_x, section_y, residual; or any field in ``extra``,
            such as worn_depth. After `flow` also flow.
        ax : matplotlib axes, optional
            Axes for a single panel: contact, pressure (the default), a field, or one of the single panels above.

        Returns
        -------
        figure, axes
            The axes of several panels are a list.
        """
        return views.load().plot_solution(self, name, ax)

    def to_xarray(self) -> Dataset:
        """Return an xarray.Dataset of the fields' local rows.

        The ``attrs`` of each field have its unit.
        """
        return to_xarray(self)

    def __getattr__(self, name: str) -> Any:
        """Return a number or text of the result by its name.

        Both its name in the result file and its name in `Solution` are accepted.
        """
        # Unpickling asks for names before there are attributes.
        attributes = self.attributes if self.__dict__ and name != "attributes" and name[0] != "_" else {}
        if (key := ATTRIBUTE_NAMES.get(name, name)) in attributes:
            return attributes[key]
        if attributes and name in self.extra:
            return self.extra[name]
        public = {*super().__dir__(), *attributes, *ATTRIBUTE_NAMES} if attributes else ()
        similar = find_similar_attribute(name, [word for word in public if word[0] != "_"])
        inverse = " (its reciprocal)" * ("resistance" in name and str(similar).endswith("_conductance"))
        hint = f"did you mean {similar}{inverse}?" if similar else "what it has: .attributes"
        if name in STIFFNESS_NUMBERS:
            hint = "it is computed by -stiffness, or by ContactSolver.with_stiffness"
        elif name in FLOW_NUMBERS:
            hint = "it is computed by -flow, or by the method flow"
        raise AttributeError(f"this {type(self).__name__.lower()} has no {name}; {hint}")

    def __dir__(self):
        """Return the names of fields, physical numbers and methods.

        All other numbers are only in `attributes`.
        """
        known = {name for name in self.attributes if name.removeprefix("analytic_") in QUANTITIES}
        return {*super().__dir__(), *known} - (self.attributes.keys() - known) - _HIDDEN | _SHOWN

    def flow(self) -> Flow:
        """Solve for the flow of a fluid through the gap. Collective.

        No fluid flows through cells in contact, and through cells where contact is impossible. The flow is computed
        once for each solution. After that `attributes` have its numbers, and `save` writes its fields, too. Options of
        the linear solver are in PETSc's database, with the prefix ``flow_``.

        Returns
        -------
        Flow
            A RuntimeWarning is issued if its proved error is above 1e-4.

        Raises
        ------
        InputError
            If PETSc refuses an option.
        """
        from app.flow.gap_flow import MAX_ERROR, solve_flow

        computed = self.__dict__.setdefault("computed", {})
        if "flow" not in computed:
            computed["flow"] = flow = solve_flow(self.gap, ~self.contact, self.grid, self.slabs, self.comm)
            self.extra.update(flow.select(FLOW_FIELDS))
            if (error := flow.flow_error) > MAX_ERROR:
                warn_caller(f"flow: the proved relative error of the transmissivities is {error:.2g}")
        return computed["flow"]

    def residual_surface(self) -> ResidualSurface:
        """Return the permanent indentation as a surface. Collective.

        To describe the indented bodies, put this surface into ``surfaces=[...]`` of a `ContactProblem` of the original
        bodies, with the same hardness. Loads up to this solution's load are then elastic. This surface replaces the
        residual surface of an earlier solution.

        Returns
        -------
        ResidualSurface
            The same on all ranks, with all rows.

        Raises
        ------
        InputError
            If the problem has no hardness.
        """
        if self.plastic is None:
            raise InputError(
                "residual_surface: the problem has no hardness, so there is no permanent indentation"
            )
        return ResidualSurface(self._all_rows(self.plastic_depth))

    def _all_rows(self, local):
        """Return a field's rows of all ranks."""
        return local  # this rank has all rows

    def patches(self) -> Patches:
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

        def centre(positions, start, period, repeats):
            if not repeats:
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
            centre(self.x[i], grid.x0, grid.sides[0], grid.repeats[1]),
            centre(self.y[j], grid.y0, grid.sides[1], grid.repeats[0]),
            grid,
        )

    def contact_patches(self) -> Floats:
        """Return the areas of the contact spots, largest first [mm2]. Collective."""
        _, cells = self._connected_sets()
        return np.sort(cells)[::-1] * self.grid.cell_area

    def _connected_sets(self):
        """Return the cells' labels, and the sizes of contact spots. Collective."""
        from app.halfspace.connected_sets import label_connected_sets

        return label_connected_sets(self.contact, self.grid.periodic, self.slabs, self.comm)

    def count_patches(self) -> dict[str, int | float]:
        """Return number and largest area of contact spots, a dict. Collective."""
        areas = self.contact_patches()
        return {"contact_patches": len(areas), "largest_patch": float(areas.max(initial=0.0))}

    def distribution(self, name: str, bins: int = 100, logarithmic: bool = False) -> tuple[Floats, Floats]:
        """Return the distribution of pressures or gaps. Collective.

        Counted are the positive pressures in contact, or the positive gaps outside contact.

        Parameters
        ----------
        name : str
            "pressure" or "gap".
        bins : int
        logarithmic : bool
            True for bins whose edges have equal ratios, false for bins of equal widths.

        Returns
        -------
        edges : ndarray, shape (bins + 1,), [N/mm2] or [mm]
            Edges of the bins, from the smallest to the largest value. If all values are equal, the edges go from half
            to twice the value. Empty without values.
        density : ndarray, shape (bins,)
            Share of the counted cells in a bin, divided by the width of the bin. The integral of the density is 1.

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
