"""Springs between bodies and surface, whose displacement products with the influence matrix add."""

from contextlib import contextmanager

import numpy as np

from app.halfspace.influence import dense_matrix
from app.parallel.reductions import sum_over


class SpringMethods:
    """Part of `InfluenceOperator` for springs.

    Attributes
    ----------
    compliance : ndarray, shape (local rows, nx), or None
        Displacement of each cell by pressure 1 on it [mm / (N/mm2)], which products add: the matrix is A plus this
        diagonal. `product` and `exact_product`, like all preconditioners, are those of A alone.
    """

    compliance = None
    _support = None  # other springs, which a safeguard adds

    @property
    def is_singular(self):
        """True if a constant pressure displaces nothing."""
        return self.grid.doubly_periodic and self.compliance is None

    @property
    def has_springs(self):
        """True if products add the displacement of springs."""
        return not (self.compliance is None and self._support is None)

    def add_springs(self, p, u):
        """Add to u = A p the displacement of all springs. Collective."""
        if self.compliance is not None:
            u += self.compliance * p
        if self._support is not None:
            self._support.add_displacement(p, u)

    @contextmanager
    def supported(self, support):
        """Add other springs in a ``with`` block; see `app.contact.tilted_load.Springs`."""
        self._support = support
        try:
            yield
        finally:
            self._support = None

    def matrix(self):
        """Return the dense matrix of a small grid. Collective; all ranks do the same work."""
        matrix = dense_matrix(self.grid, self.kernel)
        if self.compliance is not None:
            field = np.zeros(self.grid.shape)
            field[self.slabs.rows] = self.compliance
            matrix[np.diag_indices_from(matrix)] += np.ravel(sum_over(self.comm, field))
        return matrix
