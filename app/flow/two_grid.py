"""Two-grid preconditioner of the pressure in a `Network`.

Gauss-Seidel sweeps over the cells, forwards before and backwards after a coarse correction, are a symmetric smoother.
The coarse unknowns are constant on aggregates: the cells of a block of 2 x 2 cells, or those of them that are strongly
coupled [1]_. Their Galerkin matrix is again that of a network. PETSc's algebraic multigrid (hypre's BoomerAMG) solves
it approximately, by one cycle. The sweeps need the conductances only. So the large matrix of the cells is never
assembled, and algebraic multigrid, whose set-up takes as long as several solves, has about a quarter of the unknowns.

Sweeps are local to each rank, and end at the sides of the patch: there the neighbours are those before the sweep.

.. [1] A. Napov, Y. Notay, SIAM J. Sci. Comput. 34 (2012) A1079-A1109: two cells with the diagonals d and e and the
   coupling k converge well together if k (1 / d + 1 / e) is not small.
"""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_matrix

from app.base.numba_cache import njit
from app.flow.network import neighbours

# Factor of the coarse correction. Constants on blocks are stiffer than smooth fields, so the correction is too small.
# The preconditioner is positive definite if this is below 2.
_SCALE = 1.5
# Smallest strength of a coupling in an aggregate: conductance times the sum of both reciprocal diagonals. In a uniform
# gap the strength of two cells is 1/2.
_WEAKEST = 1 / 8


@njit()
def _sweep(in_x, in_y, inverse, b, x, step):
    """Gauss-Seidel sweep over a padded field x, forwards (step 1) or backwards (-1). Ghost cells stay."""
    rows, nx = b.shape
    for count in range(rows):
        j = count if step > 0 else rows - 1 - count
        last = x[j + 1, 0] if step > 0 else x[j + 1, nx + 1]
        for number in range(nx):
            i = number if step > 0 else nx - 1 - number
            inflow = in_x[j, i] * (last if step > 0 else x[j + 1, i])
            inflow += in_x[j, i + 1] * (x[j + 1, i + 2] if step > 0 else last)
            inflow += in_y[j, i] * x[j, i + 1] + in_y[j + 1, i] * x[j + 2, i + 1]
            last = inverse[j, i] * (b[j, i] + inflow)
            x[j + 1, i + 1] = last


@njit()
def _outflow(in_x, in_y, diagonal, x, y):
    """Write the matrix times a padded field x to y."""
    rows, nx = y.shape
    for j in range(rows):
        for i in range(nx):
            inflow = in_x[j, i] * x[j + 1, i] + in_x[j, i + 1] * x[j + 1, i + 2]
            inflow += in_y[j, i] * x[j, i + 1] + in_y[j + 1, i] * x[j + 2, i + 1]
            y[j, i] = diagonal[j, i] * x[j + 1, i + 1] - inflow


@njit()
def _restrict(b, y, index, sums):
    """Add the residual b - y to the aggregates of the cells."""
    for j in range(b.shape[0]):
        for i in range(b.shape[1]):
            if index[j, i] > 0:
                sums[index[j, i] - 1] += b[j, i] - y[j, i]


@njit()
def _prolong(coarse, index, x):
    """Add the value of its aggregate to each cell of a padded field x."""
    for j in range(index.shape[0]):
        for i in range(index.shape[1]):
            if index[j, i] > 0:
                x[j + 1, i + 1] += _SCALE * coarse[index[j, i] - 1]


@njit(makes_arrays=True)
def _aggregate(in_x, in_y, diagonal, is_open, index):
    """Write the number of each cell's aggregate to `index`, from 1 on; return the count.

    In each block the two strongest coupled aggregates are joined, until all couplings are too weak. Closed cells have
    the number 0.
    """
    rows, nx = index.shape
    label, weight, face = np.zeros(4, np.int64), np.zeros(4), np.zeros(4)
    first, second, count = (0, 2, 0, 1), (1, 3, 2, 3), 0  # cells at the faces in a block
    for j in range(0, rows, 2):
        for i in range(0, nx, 2):
            face[:] = 0.0
            if i + 1 < nx:
                face[0] = in_x[j, i + 1]
                face[1] = in_x[j + 1, i + 1] if j + 1 < rows else 0.0
            if j + 1 < rows:
                face[2] = in_y[j + 1, i]
                face[3] = in_y[j + 1, i + 1] if i + 1 < nx else 0.0
            for cell in range(4):
                at_j, at_i = j + cell // 2, i + cell % 2
                label[cell] = cell
                weight[cell] = diagonal[at_j, at_i] if at_j < rows and at_i < nx else 0.0
            for _ in range(3):
                best, one, other = 0.0, 0, 0
                for at in range(4):
                    a, b = label[first[at]], label[second[at]]
                    if a == b or face[at] == 0:
                        continue
                    joint = 0.0
                    for same in range(4):
                        c, d = label[first[same]], label[second[same]]
                        if (c == a and d == b) or (c == b and d == a):
                            joint += face[same]
                    strength = joint * (1 / weight[a] + 1 / weight[b])
                    if strength > best:
                        best, one, other = strength, a, b
                if best < _WEAKEST:
                    break
                weight[one] += weight[other]
                for cell in range(4):
                    label[cell] = one if label[cell] == other else label[cell]
            for cell in range(4):
                at_j, at_i = j + cell // 2, i + cell % 2
                if at_j < rows and at_i < nx and is_open[at_j, at_i]:
                    old = label[cell]
                    if old < 4:  # the first cell of its aggregate
                        count += 1
                        for later in range(cell, 4):
                            if label[later] == old:
                                label[later] = 3 + count
                    index[at_j, at_i] = label[cell] - 3
    return count


class TwoGrid:
    """Context of the matrix (Mat) of a network, and of its preconditioner (PC). Collective.

    A row of the matrix times P is the outflow of a cell; rows of closed cells are zero.

    Parameters
    ----------
    network : Network
    ties : ndarray of float64, shape (local rows, nx)
        Conductance between a cell and a given pressure, added to the diagonal; see `Network.tie`.
    prefix : str
        Prefix of PETSc's options for `solver`.

    Attributes
    ----------
    solver : PETSc.PC
        Solver of the coarse matrix; the caller sets its options.
    """

    def __init__(self, network, ties, prefix):
        self._pad, self._faces = network.pad, network.conductances
        self._comm = network.comm or PETSc.COMM_SELF
        self._diagonal = network.diagonal() + ties
        self._inverse = np.divide(1.0, self._diagonal, out=np.zeros_like(ties), where=network.is_open)
        self._index = np.zeros(ties.shape, PETSc.IntType)
        count = _aggregate(*self._faces, self._diagonal, network.is_open, self._index)
        self._matrix = self._assemble(network, count)
        self._x, self._b = self._matrix.createVecs()
        self.solver = PETSc.PC().create(self._comm)
        self.solver.setOptionsPrefix(prefix)
        self.solver.setOperators(self._matrix)

    def free(self):
        """Destroy PETSc's objects. Collective."""
        for part in (self.solver, self._x, self._b, self._matrix):
            part.destroy()

    def view(self, part, viewer):
        """Print the solver of the aggregates, for ``-flow_ksp_view``. Collective."""
        if isinstance(part, PETSc.PC):
            self.solver.view(viewer)

    def _assemble(self, network, count):
        """Return the matrix of the aggregates. Collective."""
        counts, (in_x, in_y) = network.allgather(count), self._faces
        is_open = self._index > 0
        number = (self._index + PETSc.IntType(sum(counts[: network.slabs.rank]))) * is_open  # from 1 on
        (west, east), (south, north) = neighbours(network.pad(number))
        columns = np.stack([south[:-1], west[:, :-1], number, east[:, 1:], north[1:]])
        values = np.stack([-in_y[:-1], -in_x[:, :-1], self._diagonal, -in_x[:, 1:], -in_y[1:]])
        kept = (columns > 0) & is_open
        places = np.broadcast_to(self._index, columns.shape)[kept] - 1, columns[kept] - 1
        size = count, sum(counts)
        # The conversion adds entries of the same aggregates.
        matrix = coo_matrix((values[kept], places), shape=size).tocsr()
        arrays = matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType), matrix.data
        return PETSc.Mat().createAIJ((size, size), csr=arrays, comm=self._comm)

    def mult(self, _, x, y):
        """Multiply by the matrix of the cells. Collective."""
        shape = self._inverse.shape
        y.setArray(self._multiply(self._pad(x.getArray(readonly=True).reshape(shape))).ravel())

    def _multiply(self, padded):
        y = np.empty(self._inverse.shape)
        _outflow(*self._faces, self._diagonal, padded, y)
        return y

    def apply(self, _, b, x):
        """Precondition a residual. Collective."""
        rows, nx = shape = self._inverse.shape
        b, padded = b.getArray(readonly=True).reshape(shape), np.zeros((rows + 2, nx + 2))
        _sweep(*self._faces, self._inverse, b, padded, 1)
        sums = np.zeros(self._b.getLocalSize())
        _restrict(b, self._multiply(self._pad(padded[1:-1, 1:-1])), self._index, sums)
        self._b.setArray(sums)
        self.solver.apply(self._b, self._x)
        _prolong(self._x.getArray(readonly=True), self._index, padded)
        padded = self._pad(padded[1:-1, 1:-1])
        _sweep(*self._faces, self._inverse, b, padded, -1)
        x.setArray(padded[1:-1, 1:-1].ravel())
