"""Linear solver of contact systems on lists of cells.

The unknowns are a list of cells of a grid, in which all contact is. Fields of a list have the shape (1, cells). To the
iteration a list is a grid of one row, as a window is a grid of its own.
"""

from functools import cached_property, lru_cache

import numpy as np

from app.contact.distance import UndeformedDistance
from app.contact.state import Displacement
from app.halfspace.cell_list import CellList
from app.halfspace.grid import Grid
from app.halfspace.list_product import ListProduct
from app.halfspace.operator import InfluenceOperator, get_operator
from app.halfspace.periodic_list_product import PeriodicListProduct, displacement_on_rows
from app.methods.free.solver import TrackingSolver
from app.methods.free.windows import WindowState
from app.options.method import DEFAULT, read_method_file

STENCIL_RADIUS = 8  # cells at which the inverse of A is cut off
MAX_FALL = 4.0  # of the largest displacement since the start: more is lost in its rounding


@lru_cache(maxsize=1)
def _usual_ksp():
    """Return the options of the KSP of the default method on free patches."""
    return {name: text for name, text in read_method_file(DEFAULT).items() if name.startswith("ksp_")}


class CountedProduct:
    """ListProduct of a level of a hierarchy, which counts the work.

    `number` is the number of the level, `cells` a CellList as in `ListProduct`.

    Attributes
    ----------
    grid, error_bound, diagonal
        See `ListProduct`.
    quadrant : ndarray or None
        See `PeriodicListProduct`; None on a free patch.
    inverse : LocalSum
        Sums with the inverse of A continued periodically, cut off at `STENCIL_RADIUS`.
    """

    def __init__(self, hierarchy, number, cells):
        self._hierarchy, self._level = hierarchy, hierarchy.levels[number]
        self.grid = self._level.grid
        self._product = product = _kind(self.grid)(self.grid, self._level.kernel, cells=cells)
        self.error_bound, self.diagonal = product.error_bound, product.diagonal
        self.quadrant = product.quadrant if self.grid.periodic else None
        self.inverse, self._last = product.stencil(STENCIL_RADIUS), (None, 0.0)

    @staticmethod
    def least_cost(level, cells):
        """Return the least `cost` of a product from `cells` to `cells`, of any spacing of nodes."""
        return _kind(level.grid).choose_split(level.grid, cells).cost(cells, cells) / level.product_points

    def cost(self, sources, targets):
        """Return the estimated time of a product, over that of a product on all cells of the level."""
        lists, cost = self._last
        if lists != (sources, targets):
            cost = self._product.cost(sources, targets) / self._level.product_points
            self._last = (sources, targets), cost
        return cost

    def apply(self, sources, p, targets, out=None):
        """Return u at the targets [mm]; see `ListProduct.apply`."""
        self._hierarchy.count_products(self._level, self.cost(sources, targets))
        return self._product.apply(sources, p, targets, out)


def _kind(grid):
    return PeriodicListProduct if grid.periodic else ListProduct


class ListedProduct:
    """Product with A on a list of `cells`, by a CountedProduct."""

    dtype, count, flops = np.dtype(float), 0, 0  # the CountedProduct counts

    def __init__(self, product, cells):
        self._product, self.cells, self.grid = product, CellList(product.grid, cells), product.grid
        self._mask = None

    def cells_of(self, mask):
        """Return the CellList of a mask of the listed cells."""
        if self._mask is None or (mask != self._mask).any():
            self._mask, self._contact = mask.copy(), CellList(self.grid, self.cells.cells[mask[0]])
        return self._contact

    def apply(self, p, out, mask=None):
        """Store A p, or C A C p with the mask C, in `out`."""
        inside = p != 0 if mask is None else mask
        sources = self.cells_of(inside)
        if mask is None:
            out[0] = self._product.apply(sources, p[inside], self.cells)
            return
        out[...] = 0
        out[mask] = self._product.apply(sources, p[mask], sources)

    def apply_inverse(self, r, out, mask):
        """Store C B C r in `out`, with the inverse B of A, cut off, and the mask C."""
        cells = self.cells_of(mask)
        out[...] = 0
        out[mask] = self._product.inverse.apply(cells, r[mask], cells)


class ListOperator(InfluenceOperator):
    """Influence matrix of a list of cells.

    Parameters
    ----------
    level : InfluenceOperator
        Operator of the grid.
    product : CountedProduct
    cells : ndarray
        Sorted numbers of the cells.
    """

    def __init__(self, level, product, cells):
        super().__init__(Grid(cells.size, 1, level.grid.dx, level.grid.dy), level.kernel)
        self.product = self.exact_product = ListedProduct(product, cells)
        self.error_bound, self.diagonal = product.error_bound, product.diagonal
        self.mask[...] = False


class StencilInverse:
    """Preconditioner C B C with the inverse B of A, cut off, as a PC context of a ListOperator."""

    def setUp(self, pc):
        """Get the operator; PETSc calls it for each contact set."""
        self._operator = get_operator(pc.getOperators()[1], ListOperator, "StencilInverse")

    def precondition(self, r, z, reduced=None):
        """Compute z = C B C r; see `app.methods.free.circulant.Circulant.precondition`."""
        self._operator.product.apply_inverse(r, z, self._operator.mask)

    def local_terms(self, q):
        """Return no terms; see `app.methods.free.circulant.Circulant.local_terms`."""
        return ()


class ListSolver(TrackingSolver):
    """TrackingSolver on a list of cells, without multilevel products."""

    _forced = {"pc_type": "python", "pc_python_type": "app.methods.free.list_solver.StencilInverse"}  # noqa: RUF012

    def __init__(self, hierarchy, number, operator):
        if hierarchy.target.grid.doubly_periodic:  # the options choose another KSP
            self._forced = _usual_ksp() | self._forced
        super().__init__(hierarchy, number, operator)

    def begin(self, multilevel):
        """Use the list's product, whatever `multilevel` is."""
        super().begin(False)
        self._largest = 0.0

    def _multiply_in_contact(self, p, u):
        self.operator.product.apply(p, u, self.operator.mask)

    def update_displacement(self, state):
        """Update u by the last change of p; see `TrackingSolver.update_displacement`.

        The sum of products is as accurate as the product of the sum, unless it is much smaller than the products.
        """
        self._largest = max(self._largest, np.abs(state.u).max())
        super().update_displacement(state)
        small = self._largest > MAX_FALL * np.abs(state.u).max()
        if state.displacement_status is Displacement.UPDATED and not small:
            state.displacement_status = Displacement.EXACT


class ListFields:
    """Fields of all cells of a grid for listeners, from a ListState. They are made when they are first used."""

    def __init__(self, state):
        product = state.operator.exact_product
        self._state, self._kernel = state, state.operator.kernel
        self.grid, self._cells = product.grid, product.cells
        self.depth, self.approach = state.depth, state.approach

    def _expand(self, values):
        field = np.zeros(self.grid.shape, values.dtype)
        field.flat[self._cells.cells] = values[0]
        return field

    contact = cached_property(lambda self: self._expand(self._state.contact))
    p = cached_property(lambda self: self._expand(self._state.p))

    @cached_property
    def u(self):
        """Displacement A p [mm]."""
        rows = slice(0, self.grid.ny)
        return displacement_on_rows(self.grid, self._kernel, self._cells.cells, self._state.p[0], rows)


class _Values:
    """Stand-in for a Scatter: it has -h and hardness of the listed cells, all of which are admissible."""

    def __init__(self, whole, b, upper):
        self._whole, self._b = whole, b[None].copy()
        self._upper = None if upper is None else upper[None]

    def forward(self, field):
        if field.dtype == bool:
            return np.ones(self._b.shape, bool)
        if field is self._whole.b:
            return self._b
        return self._upper if field is self._whole.bounds.upper else None


class ListState(WindowState):
    """Contact state of a list of cells, outside of which there is no pressure.

    Parameters
    ----------
    operator : ListOperator
    whole : UndeformedDistance
        Undeformed distance on all cells of the grid.
    b : ndarray, shape (cells,), [mm]
        -h of the listed cells at depth 0.
    upper : ndarray, shape (cells,), [N/mm2], or None
        Hardness of these cells.
    p : ndarray, shape (cells,), [N/mm2]
        Initial pressure, limited to the hardness; C are the cells with pressures between their bounds.
    depth : float
        Initial depth [mm].
    iterations_before : int
        See `ContactState`.
    """

    def __init__(self, operator, whole, b, upper, p, depth, iterations_before=0):
        super().__init__(operator, UndeformedDistance.part_of(whole, operator, _Values(whole, b, upper)))
        self.bounds.project(p[None], self.admissible, self.values)
        self.contact[...] = self.bounds.between(self.p)
        self.depth, self.displacement_status = depth, Displacement.STALE
        self.distance.touching, self.iterations_before = whole.touching, iterations_before

    def fields(self):
        """Return the `ListFields`."""
        return ListFields(self)

    def lift(self):
        """Improve pressures copied from a coarser grid, which leave gaps and overlaps in contact.

        As in `app.methods.free.lift` the inverse of A computes the pressure that closes the gaps of contact and of
        overlapping cells. Cells whose pressures reach a bound then leave C.
        """
        self.compute_displacement()
        gap, change, plastic = self.gap(), np.empty(self.p.shape), self.bounds.plastic(self.p)
        self.contact[...] = self.bounds.contact(self.p, gap)
        if plastic is not None:
            plastic &= ~self.contact
        self.operator.product.apply_inverse(gap, change, self.contact)
        self.values[...] -= change
        self.bounds.project_sets(self.values, self.contact, plastic)
        self.contact[...] &= self.bounds.between(self.p)
        self.displacement_status = Displacement.STALE

    def box_of_contact(self):
        """Return the number of the grid's cells in the bounding box of contact, at least 1."""
        cells = self.operator.product.cells_of(self.in_contact())
        return max(int(np.prod([np.ptp(at) + 1 for at in (cells.ix, cells.iy)])), 1) if len(cells) else 1
