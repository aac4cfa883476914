"""Jacobi and Gauss-Seidel as smoothers of a line contact (Sec. 4.4).

A long cylinder touches a plane on the strip [-2.56, 2.56] x [-500, 500] mm, cut into n x 1 cells. The matrix A is
dense, symmetric and Toeplitz: A = L + D + L^T, with the diagonal D and the strict lower triangle L. A sweep maps the
error e^i = p - p^i after i sweeps to S e^i, with the iteration matrix S.

Modes, the eigenvectors v^j of S, are sorted by decreasing modulus of their eigenvalue. The paper numbers modes in
another way. Its figures fit if its mode 1 has the eigenvalue 0, which undamped Gauss-Seidel always has, and all other
modes follow by decreasing modulus: see `paper_mode_index`.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.material import Material

PAPER_MODES = (2, 4, 6, 8, 18, 32)  # of Fig. 7
SMOOTH_MODES = PAPER_MODES[:4]  # these have a partner on the coarse grid
STEEL = Material(shear_modulus=82000.0, poisson_ratio=0.28)


@dataclass(frozen=True)
class LineContact:
    """Contact of a long cylinder, one row of cells (Sec. 4.4).

    The grid is `cells` cells wide and one cell long. `half_width` and `half_length` are half its sides [mm].
    """

    cells: int = 32
    half_width: float = 2.56
    half_length: float = 500.0
    material: Material = STEEL

    @property
    def grid(self):
        """Grid of n x 1 cells."""
        domain = (-self.half_width, self.half_width, -self.half_length, self.half_length)
        return Grid.from_domain(self.cells, 1, domain)

    def matrix(self):
        """Return the influence matrix A, shape (n, n) [mm / (N/mm2)]."""
        return dense_matrix(self.grid, self.material.kernel)

    def pressure(self):
        """Return the pressure divided by its maximum, sqrt(1 - (x / half_width)^2)."""
        return np.sqrt(1 - (self.grid.x() / self.half_width) ** 2)


class Modes(NamedTuple):
    """Eigenvalues (n,) and eigenvectors (n, n) of an iteration matrix.

    Eigenvectors are columns. A vector's mean square is 1, and the largest component is real and positive, so that
    vectors of different grids can be compared. In a conjugate pair, the eigenvalue with the positive imaginary part is
    first.
    """

    values: np.ndarray
    vectors: np.ndarray


class SweepHistory(NamedTuple):
    """Errors p - p^i after some numbers of sweeps i (Fig. 6).

    `errors` and their `coefficients` c_j in the eigenvectors have shape (sweeps, n): ``error = sum_j c_j v^j``.
    """

    sweeps: tuple[int, ...]
    errors: np.ndarray
    coefficients: np.ndarray


class ModePair(NamedTuple):
    """Mode of Gauss-Seidel on a fine and on a coarse grid (Fig. 7).

    `number` is the paper's. The coarse mode has the phase of the fine one, and is None unless the mode is smooth.
    """

    number: int
    vector: np.ndarray
    value: complex
    coarse_vector: np.ndarray | None = None
    coarse_value: complex | None = None


def jacobi(matrix, omega=1.0):
    """Return Jacobi's iteration matrix ``I - omega D^-1 A`` (Fig. 5(a)).

    With the factor `omega` = 1 there is no damping.
    """
    return np.eye(len(matrix)) - omega * matrix / np.diag(matrix)[:, None]


def gauss_seidel(matrix, omega=1.0):
    """Return the iteration matrix ``I - (D / omega + L)^-1 A`` of Gauss-Seidel (Fig. 5(b)).

    D is the diagonal and L the strict lower triangle of A. The order of the cells is lexicographic.
    """
    lower = np.tril(matrix, -1) + np.diag(np.diag(matrix) / omega)
    return np.eye(len(matrix)) - solve_triangular(lower, matrix, lower=True)


def modes(iteration_matrix):
    """Return the `Modes` of an iteration matrix."""
    values, vectors = np.linalg.eig(iteration_matrix)
    # Stable: the two of a pair have equal moduli to the bit, and LAPACK returns the positive one first.
    order = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None, :], axis=0)
    vectors = vectors / (largest / np.abs(largest))
    return Modes(values, vectors * np.sqrt(len(values)))


def paper_mode_index(number, n):
    """Return the index in `Modes` of the paper's mode, from 1 to n."""
    if not 1 <= number <= n:
        raise ValueError(f"mode {number}: must be from 1 to {n}")
    return (number - 2) % n  # the paper's first mode is the last in `Modes`


def sweep_history(iteration_matrix, solution, sweeps=(0, 10, 20)):
    """Return the `SweepHistory` of an iteration that starts from zero (Fig. 6).

    The error after i sweeps with the iteration matrix S is S^i p, where the `solution` p is exact.
    """
    errors = np.stack([np.linalg.matrix_power(iteration_matrix, i) @ solution for i in sweeps])
    coefficients = np.linalg.solve(modes(iteration_matrix).vectors, errors.T.astype(complex)).T
    return SweepHistory(tuple(sweeps), errors, coefficients)


def compare_grids():
    """Return `PAPER_MODES` of Gauss-Seidel as pairs on two grids (Fig. 7).

    The coarse grid has half as many cells.
    """
    contact = LineContact()
    half = replace(contact, cells=contact.cells // 2)
    fine, coarse = (modes(gauss_seidel(c.matrix())) for c in (contact, half))
    pairs = []
    for number in PAPER_MODES:
        j = paper_mode_index(number, contact.cells)
        v, partner = fine.vectors[:, j], ()
        if number in SMOOTH_MODES:
            k = paper_mode_index(number, half.cells)
            overlap = np.vdot(coarse.vectors[:, k], v.reshape(-1, 2).mean(axis=1))
            partner = coarse.vectors[:, k] * overlap / np.abs(overlap), coarse.values[k]
        pairs.append(ModePair(number, v, fine.values[j], *partner))
    return pairs
