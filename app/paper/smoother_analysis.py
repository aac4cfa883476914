"""Jacobi and Gauss-Seidel as smoothers of a line contact (Sec. 4.4).

A long cylinder touches a plane on the strip [-2.56, 2.56] x [-500, 500] mm, cut into 32 x 1 cells. The matrix
A is dense, symmetric and Toeplitz: A = L + D + L^T, with the diagonal D and the strict lower triangle L. p^i
is the pressure after i sweeps. A sweep maps the error e^i = p - p^i to S e^i, with the iteration matrix S.

=========================  ==============================  ============================
paper                      here                            shape, unit
=========================  ==============================  ============================
A                          ``LineContact.matrix()``        (n, n), mm / (N/mm2)
p                          ``LineContact.pressure()``      (n,), relative to its maximum
iteration matrix           ``jacobi``, ``gauss_seidel``    (n, n), 1
eigenvalues, v^j           ``Modes.values``, ``vectors``   (n,), (n, n), 1
e^i, c                     ``SweepHistory``                (sweeps, n), as p
v_h^j and v_H^j            ``ModePair``                    (n,), (n/2,), 1
=========================  ==============================  ============================

Modes are sorted by decreasing modulus of their eigenvalue. The paper numbers modes in another way. Its figures fit if
its mode 1 has the eigenvalue 0, which undamped Gauss-Seidel always has, and all other modes follow by decreasing
modulus: see `paper_mode_index`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.material import Material

#: Modes of Fig. 7; the first four are smooth and have a partner on the coarse grid.
PAPER_MODES = (2, 4, 6, 8, 18, 32)
SMOOTH_MODES = PAPER_MODES[:4]
STEEL = Material(shear_modulus=82000.0, poisson_ratio=0.28)


@dataclass(frozen=True)
class LineContact:
    """Contact of a long cylinder, one row of cells (Sec. 4.4).

    Attributes
    ----------
    cells : int
        Number of cells across the strip, n.
    half_width, half_length : float
        Half width and half length of the strip [mm].
    material : Material
        Combined material of the two bodies.
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
        """Return the pressure, divided by its maximum, shape (n,).

        The returned numbers are sqrt(1 - (x / half_width)^2).
        """
        return np.sqrt(1 - (self.grid.x() / self.half_width) ** 2)


@dataclass(frozen=True)
class Modes:
    """Eigenvalues and eigenvectors of an iteration matrix, by decreasing modulus.

    Attributes
    ----------
    values : ndarray of complex, shape (n,)
        Eigenvalues. In a conjugate pair, the one with the positive imaginary part is first.
    vectors : ndarray of complex, shape (n, n)
        Eigenvectors v^j as columns. Their mean square is 1 (Euclidean norm sqrt(n)) and their largest
        component is real and positive, so that vectors of different grids can be compared.
    """

    values: np.ndarray
    vectors: np.ndarray

    def coefficients(self, error):
        """Return coefficients c_j of errors in eigenvectors v^j.

        ``error = sum_j c_j v^j``. `error` and result have shape (n,), or (k, n) for k errors.
        """
        return np.linalg.solve(self.vectors, np.asarray(error, dtype=complex).T).T


@dataclass(frozen=True)
class SweepHistory:
    """Errors after several numbers of sweeps (Fig. 6).

    Attributes
    ----------
    sweeps : tuple of int
        Numbers of sweeps i.
    errors : ndarray, shape (len(sweeps), n)
        Errors p - p^i, in units of p.
    coefficients : ndarray of complex, shape (len(sweeps), n)
        Coefficients of the errors in the eigenvectors of the iteration matrix, in the order of `Modes`.
    """

    sweeps: tuple[int, ...]
    errors: np.ndarray
    coefficients: np.ndarray


@dataclass(frozen=True)
class ModePair:
    """Mode of Gauss-Seidel on a fine and a coarse grid (Fig. 7).

    Only smooth modes have a partner, the mode of the same number on the coarse grid.

    Attributes
    ----------
    number : int
        Number of the mode in the paper.
    vector, value : ndarray of complex, complex
        Eigenvector and eigenvalue on the fine grid.
    coarse_vector, coarse_value : as above, or None
        Eigenvector and eigenvalue of the partner, on half as many cells. The phase of the eigenvector is that of the
        fine one.
    """

    number: int
    vector: np.ndarray
    value: complex
    coarse_vector: np.ndarray | None = None
    coarse_value: complex | None = None


def jacobi(matrix, omega=1.0):
    """Return Jacobi's iteration matrix ``I - omega D^-1 A`` (Fig. 5(a)).

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
    omega : float
        Damping factor, 1 for none.

    Returns
    -------
    ndarray, shape (n, n)
    """
    return np.eye(len(matrix)) - omega * matrix / np.diag(matrix)[:, None]


def gauss_seidel(matrix, omega=1.0):
    """Return Gauss-Seidel's iteration matrix (Fig. 5(b)).

    The matrix is ``I - (D / omega + L)^-1 A``; the order is lexicographic. Parameters and result are those of `jacobi`.
    """
    lower = np.tril(matrix, -1) + np.diag(np.diag(matrix) / omega)
    return np.eye(len(matrix)) - solve_triangular(lower, matrix, lower=True)


def modes(iteration_matrix):
    """Compute eigenvalues and eigenvectors of an iteration matrix.

    Parameters
    ----------
    iteration_matrix : ndarray, shape (n, n)

    Returns
    -------
    Modes
    """
    values, vectors = np.linalg.eig(iteration_matrix)
    # Stable: the two of a pair have equal moduli to the bit, and LAPACK returns the positive one first.
    order = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None, :], axis=0)
    vectors = vectors / (largest / np.abs(largest))
    return Modes(values, vectors * np.sqrt(len(values)))


def paper_mode_index(number, n):
    """Return the index in `Modes` of the paper's mode.

    The paper's `number` is from 1 to n.
    """
    if not 1 <= number <= n:
        raise ValueError(f"mode {number}: must be from 1 to {n}")
    return (number - 2) % n  # the paper's first mode is the last in `Modes`


def sweep_history(iteration_matrix, solution, sweeps=(0, 10, 20)):
    """Compute the errors of an iteration that starts from zero (Fig. 6).

    The error after i sweeps with the iteration matrix S is p - p^i = S^i p, where p is the exact solution.

    Parameters
    ----------
    iteration_matrix : ndarray, shape (n, n)
    solution : ndarray, shape (n,)
        Exact solution p of the discrete system.
    sweeps : sequence of int
        Numbers of sweeps, 0 or more.

    Returns
    -------
    SweepHistory
    """
    errors = np.stack([np.linalg.matrix_power(iteration_matrix, i) @ solution for i in sweeps])
    return SweepHistory(tuple(sweeps), errors, modes(iteration_matrix).coefficients(errors))


def compare_grids(contact=None):
    """Compute Gauss-Seidel modes on two grids (Fig. 7).

    The coarse grid has half as many cells. A smooth mode is paired with the coarse mode of the same number
    (`paper_mode_index`).

    Parameters
    ----------
    contact : LineContact, optional
        Contact on the fine grid, with an even number of cells; default: the paper's 32.

    Returns
    -------
    list of ModePair

    Raises
    ------
    ValueError
        If the number of cells is odd, or a mode number is not on the grid.
    """
    contact = contact or LineContact()
    if contact.cells % 2:
        raise ValueError(f"line contact of {contact.cells} cells: need an even number to halve")
    half = LineContact(contact.cells // 2, contact.half_width, contact.half_length, contact.material)
    fine, coarse = (modes(gauss_seidel(c.matrix())) for c in (contact, half))
    pairs = []
    for number in PAPER_MODES:
        j = paper_mode_index(number, contact.cells)
        v = fine.vectors[:, j]
        partner = {}
        if number in SMOOTH_MODES:
            j_coarse = paper_mode_index(number, half.cells)
            w = coarse.vectors[:, j_coarse]
            overlap = np.vdot(w, v.reshape(-1, 2).mean(axis=1))
            partner = {
                "coarse_vector": w * overlap / np.abs(overlap),
                "coarse_value": coarse.values[j_coarse],
            }
        pairs.append(ModePair(number, v, fine.values[j], **partner))
    return pairs
