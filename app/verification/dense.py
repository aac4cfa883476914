"""Exact solutions of small contact problems by pivoting on the dense matrix.

The solutions share only the influence matrix A with the solvers under test. `solve_by_lemke` is exact, in
rational numbers, for a few cells. `DenseProblem` finds open, elastic and plastic cells by block principal pivoting,
and refines pressures in extended precision.

References
----------
C.E. Lemke, Bimatrix equilibrium points and mathematical programming, Management Sci. 11 (1965) 681. J.J. Judice,
F.M. Pires, A block principal pivoting algorithm for large-scale strictly monotone linear complementarity problems,
Computers Ops Res. 21 (1994) 587; they also treat upper bounds.
"""

from fractions import Fraction
from math import ulp

import numpy as np
from scipy.fft import irfft2
from scipy.linalg import lu_factor, lu_solve

from app.halfspace.influence import dense_matrix
from app.halfspace.periodic_symbol import fold_offsets

_PATIENCE = 3  # number of block pivots without fewer wrong cells, before single pivots
_OPEN, _ELASTIC, _PLASTIC = 0, 1, 2


def solve_by_lemke(matrix, h, hardness=None):
    """Return the solution p of a linear complementarity problem by Lemke's pivoting.

    The problem is ``h + A p >= 0, p >= 0, p (h + A p) = 0``, with a positive semidefinite matrix A (n, n) and h (n,).
    With a hardness H (n,), infinite where the pressure has no limit, it is ``h + A p + w >= 0``, and ``H - p >= 0, w >=
    0, w (H - p) = 0``, where w is the plastic depth. The arithmetic is exact, with fractions; only the result is
    rounded.
    """
    n = len(h)
    if hardness is not None:
        limited = np.eye(n)[np.isfinite(hardness)]
        matrix = np.block([[matrix, limited.T], [-limited, np.zeros((len(limited), len(limited)))]])
        return solve_by_lemke(matrix, np.concatenate([h, hardness[np.isfinite(hardness)]]))[:n]
    if (h >= 0).all():
        return np.zeros(n)
    # e - A p - z = h: columns e_0 .. e_{n-1}, p_0 .. p_{n-1}, z, right-hand side; a row for each basic variable
    rows = [
        [Fraction(int(i == j)) for j in range(n)]
        + [Fraction(-float(a)) for a in matrix[i]]
        + [Fraction(-1), Fraction(float(h[i]))]
        for i in range(n)
    ]
    basis, entering = list(range(n)), 2 * n
    row = n - 1 - int(np.argmin(h[::-1]))  # of equal ones the last: lexicographically the least
    while True:
        leaving, basis[row] = basis[row], entering
        pivot = rows[row][entering]
        rows[row] = [value / pivot for value in rows[row]]
        for i in range(n):
            if i != row and rows[i][entering]:
                factor = rows[i][entering]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[row], strict=True)]
        if leaving == 2 * n:
            break
        entering = (leaving + n) % (2 * n)  # the complement of what has left
        # Lexicographic ratios: no cycles
        ratios = [
            ([rows[i][-1] / rows[i][entering], *(x / rows[i][entering] for x in rows[i][:n])], i)
            for i in range(n)
            if rows[i][entering] > 0
        ]
        ends = [i for (first, *_), i in ratios if basis[i] == 2 * n and first == min(r[0][0] for r in ratios)]
        row = ends[0] if ends else min(ratios)[1]
    p = np.zeros(n)
    for i, name in enumerate(basis):
        if name >= n:
            p[name - n] = float(rows[i][-1])
    return p


def long_matrix(grid, kernel):
    """Return A in extended precision, shape (n, n).

    The coefficients of a periodic patch are not rounded to doubles, because this would change the smallest eigenvalues.
    """
    if not grid.doubly_periodic:
        return dense_matrix(grid, kernel).astype(np.longdouble)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    symbol = kernel.eigenvalues(grid, i[: grid.nx // 2 + 1], j[: grid.ny // 2 + 1]).T
    first = irfft2(symbol[fold_offsets(j, grid.ny)].astype(np.clongdouble), s=grid.shape)  # row of the matrix
    dj, di = (j[:, None] - j) % grid.ny, (i[:, None] - i) % grid.nx
    return first[dj[:, None, :, None], di[None, :, None, :]].reshape(grid.n, grid.n)


class DenseProblem:
    """Small contact problem, with its influence matrix as a dense array.

    Parameters
    ----------
    problem : ContactProblem
        Problem whose gap is an array, with or without a hardness.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        Influence matrix A in double precision.
    inside : ndarray of bool, shape (n,)
        Cells where contact is possible.
    """

    def __init__(self, problem):
        self.grid = problem.grid
        self._matrix = long_matrix(self.grid, problem.kernel)
        varies = problem.compliance is not None
        if varies:
            self._matrix[np.diag_indices(self.grid.n)] += problem.compliance.ravel()
        self.matrix = self._matrix.astype(float)
        gap = np.asarray(problem.gap, float).ravel()
        self.inside = ~np.isnan(gap)
        self._heights = gap[self.inside]
        self._least = np.longdouble(self._heights.min())
        self._gap = self._heights.astype(np.longdouble) - self._least  # counted from first touch
        self._a = self.matrix[np.ix_(self.inside, self.inside)]
        self._long = self._matrix[np.ix_(self.inside, self.inside)]
        # On all cells of a periodic patch A is singular.
        self._singular = self.grid.doubly_periodic and self.inside.all() and not varies
        hardness = np.inf if problem.hardness is None else problem.hardness
        self._upper = np.broadcast_to(hardness, self.grid.shape).ravel()[self.inside].astype(np.longdouble)
        self._sets = None  # the last open, elastic and plastic cells, a good guess of the next

    @property
    def largest_load(self):
        """Largest load, at which all cells are plastic [N]."""
        return float(self.grid.cell_area * self._upper.sum())

    def at(self, approach):
        """Return the pressure at an approach, shape (ny, nx) [N/mm2].

        In full contact, the smallest possible pressure is returned.
        """
        depth = np.longdouble(approach) - self._least
        beyond = float(depth - self._gap.mean())
        rounding = 4 * ulp(max(abs(approach), abs(float(self._least))))  # see docs/periodic.md
        if self._singular and (abs(beyond) <= rounding or (beyond > 0 and np.isinf(self._upper).all())):
            full = self._full()
            if (full <= self._upper).all():
                return self._field(full)
        return self._field(self._pivot(depth))

    def with_mean_gap(self, mean_gap):
        """Return the pressure at a mean gap of a periodic patch [N/mm2].

        The patch must not have holes. The mean gap is the mean of h + u, which is negative in plastic cells.
        """
        # Near first touch extended precision has too few digits of the mean.
        mean = sum(Fraction(float(h)) for h in self._heights) / self._heights.size
        depth = mean - Fraction(float(self._least)) - Fraction(float(mean_gap))
        rest = depth - Fraction(float(depth))
        depth = np.longdouble(float(depth)) + float(rest)
        if mean_gap > 0:
            return self._field(self._pivot(depth))
        return self.at(self._least + depth)

    def under(self, load, approach):
        """Return pressure [N/mm2] and approach [mm] under a load [N].

        `approach` is the first guess. If several approaches have this load, the smallest one is returned. Raises
        ValueError if the load exceeds the largest one by more than rounding.
        """
        sum_p, most = np.longdouble(load) / self.grid.cell_area, self._upper.sum()
        full = self._full() if self._singular else None
        if load == 0:
            return self._field(np.zeros(self._gap.size)), float(self._least)
        if sum_p > most * (1 + 1e-15):
            raise ValueError(f"load {load}: larger than {self.largest_load}")
        high, low = np.longdouble(np.inf), np.longdouble(0)
        if np.isfinite(most):
            high = (self._gap + self._long @ self._upper).max()  # all cells are plastic
            if sum_p >= most * (1 - 1e-15):
                return self._field(self._upper), float(self._least + high)
        if full is not None:
            more = full + (sum_p - full.sum()) / full.size
            if (more >= 0).all() and (more <= self._upper).all():
                return self._field(more), float(self._least + self._gap.mean())
            if (full <= self._upper).all():
                low, high = (low, self._gap.mean()) if sum_p < full.sum() else (self._gap.mean(), high)
        # The load grows with the approach and is piecewise linear: Newton's method within a bracket.
        depth = np.longdouble(approach) - self._least
        for _ in range(300):
            if not low < depth < high:
                guess = low + sum_p * self._a[0, 0] if low == 0 else 2 * low
                depth = (low + high) / 2 if np.isfinite(high) else guess
            p = self._pivot(depth)
            off = sum_p - p.sum()
            low, high = (depth, high) if off > 0 else (low, depth)
            if abs(off) <= 1e-16 * sum_p or high - low <= 1e-18 * low:
                break
            slope = self._linear(self._sets, np.ones(self._gap.size)).sum()
            depth = depth + off / slope if slope > 0 else low
        tiny = 4e-16 * sum_p  # rounding of the load
        plastic = p >= self._upper - tiny
        if plastic.any() and (plastic | (p <= tiny)).all():
            depth = (self._gap + self._long @ p)[plastic].max()
        return self._field(p), float(self._least + depth)

    def energy(self, pressure):
        """Return the energy norm ||p||_A, a seminorm on periodic patches."""
        p = np.asarray(pressure, np.longdouble).ravel()
        return float(np.sqrt(max(p @ (self._matrix @ p), 0.0)))

    def _field(self, p):
        whole = np.zeros(self.grid.n, np.longdouble)
        whole[self.inside] = p
        return whole.reshape(self.grid.shape)

    def _full(self):
        """Return the pressure of full contact whose smallest value is 0.

        The equation A p = mean(h) - h determines p up to a constant.
        """
        right = self._gap.mean() - self._gap
        inverse = np.linalg.pinv(self._a, rcond=1e-13, hermitian=True)
        p = np.zeros(right.size, np.longdouble)
        for _ in range(4):
            p += inverse @ (right - self._long @ p).astype(float)
        return p - p.min()

    def _linear(self, sets, right):
        """Solve A_CC p = right on elastic cells C; p = 0 elsewhere."""
        p = np.zeros(sets.size, np.longdouble)
        members = np.flatnonzero(sets == _ELASTIC)
        if not members.size:
            return p
        factors = lu_factor(self._a[np.ix_(members, members)])
        exact, b = self._long[np.ix_(members, members)], np.asarray(right, np.longdouble)[members]
        x = lu_solve(factors, b.astype(float)).astype(np.longdouble)
        for _ in range(3):
            x += lu_solve(factors, (b - exact @ x).astype(float))
        p[members] = x
        return p

    def _leave_full_contact(self, sets, h):
        """Remove one cell from full elastic contact; return the new sets.

        Elastic contact of all cells has no solution, because A is singular. The pressure of full contact is known up to
        a constant, which decreases until a cell opens, or grows until a cell is plastic.
        """
        full, sets = self._full(), sets.copy()
        if h.mean() >= 0 or np.isinf(self._upper).all():
            sets[np.argmin(full)] = _OPEN
        else:
            sets[np.argmin(self._upper - full)] = _PLASTIC
        return sets

    def _pivot(self, depth):
        h, limited = self._gap - depth, np.isfinite(self._upper).any()
        sets = np.where(h < 0, _ELASTIC, _OPEN) if self._sets is None else self._sets
        fewest, patience = h.size + 1, _PATIENCE
        for _ in range(100 * h.size + 100):
            if self._singular and (sets == _ELASTIC).all():
                sets = self._leave_full_contact(sets, h)
            bound = np.where(sets == _PLASTIC, self._upper, 0)
            p = bound + self._linear(sets, -h - self._long @ bound)
            u = self._long @ p
            e = h + u
            rounding = 1e-18 * abs(h).max() + 1e-16 * abs(u).max()
            if self._singular and (sets != _ELASTIC).sum() == 1:
                # e of a single cell is known without rounding.
                e[sets != _ELASTIC] = h.sum() if limited else 0
            most = abs(p).max()
            new = np.select(
                [
                    (sets == _ELASTIC) & (p < -1e-15 * most),
                    (sets == _ELASTIC) & (p > self._upper + 1e-15 * most),
                    ((sets == _OPEN) & (e < -rounding)) | ((sets == _PLASTIC) & (e > rounding)),
                ],
                [_OPEN, _PLASTIC, _ELASTIC],
                sets,
            )
            wrong = new != sets
            if not wrong.any():
                self._sets = sets
                return np.clip(p, 0, self._upper)
            patience = _PATIENCE if wrong.sum() < fewest else patience - 1
            fewest = min(fewest, wrong.sum())
            last = np.arange(h.size) == np.flatnonzero(wrong)[-1]
            sets = new if patience > 0 else np.where(last, new, sets)
        raise ArithmeticError("rounding keeps pivoting from its end")
