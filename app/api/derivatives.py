"""Derivatives of solutions: stiffness, conductance and sensitivities.

All follow from linear systems ``A y = g`` on the elastic contact cells, with y = 0 elsewhere. On these cells A p =
approach - shape. So a change of the shape by s changes p by -y, where A y = s, while no cell changes its state. The
pressure is piecewise linear in the shape and the approach, with a kink where a cell enters or leaves contact. Let q be
the solution for g = 1:

- The stiffness dF/d(approach) is dx dy sum(q). Plastic cells are left out, because their pressure stays at the
  hardness. When the contact unloads, they become elastic, so the unloading stiffness has all contact cells.
- At a fixed approach, a number J(p) with dJ/dp = g has dJ/d(shape) = -y. For the load, y = dx dy q.
- At a fixed load, the approach changes by s.q / sum(q). So dJ/d(shape) = -y + q sum(y) / sum(q).
- At a fixed mean gap, the approach changes by mean(s). So dJ/d(shape) = -y + sum(y) / cells. If the cells have a
  compliance D of their own, their displacement D p has a mean, too. With the solution z for g = D, dJ/d(shape) = -y +
  (1 - z) sum(y) / (cells - sum(z)).

A layer on a rigid base of a periodic patch is also compressed by c times the mean pressure, which A does not include.
So at a fixed approach, y is the solution for the matrix ``A + c / cells``: -y becomes -y + q c sum(y) / (cells + c
sum(q)).

By Barber's theorem, the electrical and thermal conductance of two half-spaces in contact are proportional to the
unloading stiffness [1]_.

.. [1] J. R. Barber, Bounds on the electrical resistance between contacting elastic rough bodies, Proc. R. Soc. Lond. A
   459 (2003) 53-66.
"""

from contextlib import ExitStack, contextmanager
from dataclasses import replace

import numpy as np

from app.api.solution import Solution
from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.base.mpi import MPI
from app.base.petsc import synchronized
from app.base.types import ArrayLike, Floats
from app.contact.periodic_state import contact_state
from app.contact.tilt import linear_sums
from app.multigrid.linear_solver import LinearSolver
from app.options.solver_options import temporary_options
from app.parallel.reductions import sum_over
from app.problems.arrays import real_numbers

RTOL = 1e-8  # of ||A q - 1||; the error of the stiffness is smaller
SENSITIVITY_RTOL = 1e-10  # of ||A y - g||; the error of y itself is larger
_MAX_IT = 2000
_OPTIONS = {
    "ksp_type": "cg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_atol": "0",
    "ksp_max_it": str(_MAX_IT),
    "pc_type": "python",
    "pc_python_type": "app.methods.free.circulant.Circulant",
    "pc_circulant_extend": "0",
}
_MM = 1e-3  # m


def find_elastic_cells(solution):
    """Return a mask of contact cells whose pressure is between its bounds."""
    return solution.contact if solution.plastic is None else solution.contact & ~solution.plastic


@contextmanager
def contact_system(hierarchy, distance, cells, rtol):
    """Yield a solver of ``A y = g`` on a set of cells. Collective.

    The function ``solve(g)`` returns y, which is 0 on cells other than `cells` (local rows), and NaN if the linear
    solver does not converge. `distance` is the undeformed distance on the target grid, `rtol` the relative tolerance of
    the residual's norm.
    """
    operator = hierarchy.target
    hierarchy.prepare_target()
    state = contact_state(operator, distance)
    with ExitStack() as stack:
        stack.callback(state.destroy)
        state.contact[...] = cells
        stack.enter_context(operator.double_precision())
        options = _OPTIONS | {"ksp_rtol": str(rtol)}
        stack.enter_context(temporary_options(hierarchy.prefix, {}, options))
        solver = LinearSolver(hierarchy, operator=operator)
        stack.callback(solver.destroy)
        solver.set_contact()

        def solve(g):
            state.right.setArray(np.where(cells, g, 0.0).reshape(-1))
            y, iterations, failure = solver.solve(state.right, np.inf)
            has_converged = not failure and iterations < _MAX_IT
            return y.getArray(readonly=True).reshape(cells.shape) * (1.0 if has_converged else np.nan)

        yield solve


def conductances(material, width):
    """Return a contact's electrical [S] and thermal [W/K] conductance, by name.

    Only those are returned for which the material has the constants, resistivities [ohm m] or thermal conductivities
    [W/(m K)]. `width` is the unloading stiffness over E* [mm].
    """
    result = {}
    if material.resistivity is not None:
        result["electrical_conductance"] = 2 * _MM * width / sum(material.resistivity)
    if material.thermal_conductivity is not None:
        result["thermal_conductance"] = 2 * _MM * width / sum(1 / k for k in material.thermal_conductivity)
    return result


class Derivatives:
    """Methods of `ContactSolver` that compute derivatives of its solutions."""

    @synchronized
    def stiffness(self, solution: Solution) -> float:
        """Compute the contact stiffness dF/d(approach) of a solution.

        This takes one more linear solve.

        Parameters
        ----------
        solution : Solution
            Solution of this problem, grid and communicator.

        Returns
        -------
        float
            Stiffness [N/mm]; 0 without contact, infinite for full contact on a periodic patch, NaN if the linear solver
            does not converge.
        """
        self._check_solution(solution)
        return self._stiffness_of(find_elastic_cells(solution))

    @synchronized
    def with_stiffness(self, solution: Solution, tilts: bool = False) -> Solution:
        """Return a solution with its stiffness and conductance.

        This takes one more linear solve, or two if there are plastic cells.

        Parameters
        ----------
        solution : Solution
            Solution of this problem, grid and communicator.
        tilts : bool
            Compute `tilt_stiffness`, too, by three more linear solves.

        Returns
        -------
        Solution
            A copy with `stiffness`, `unloading_stiffness` and `conductance_width`. The copy has
            `electrical_conductance` and `thermal_conductance` if the problem's material has the constants, see
            `Material.conducting`. With a coating or a surface compliance only the stiffness is known.
        """
        self._check_solution(solution)
        if tilts:
            solution = replace(solution, tilt_stiffness=self._tilt_stiffness_of(find_elastic_cells(solution)))
        if solution.stiffness is not None:
            return solution
        elastic = find_elastic_cells(solution)
        unloading = stiffness = self._stiffness_of(solution.contact)
        if self._sum(elastic) < self._sum(solution.contact):
            stiffness = self._stiffness_of(elastic)
        solution = replace(solution, stiffness=stiffness, unloading_stiffness=unloading)
        # Barber's theorem holds for half-spaces only.
        if not self.problem.material.is_half_space or np.any(self.problem.surface_compliance):
            return solution
        width = unloading / self.problem.material.contact_modulus
        return replace(solution, conductance_width=width, **conductances(self.problem.material, width))

    @synchronized
    def sensitivity(self, solution: Solution, of: str | ArrayLike = "load") -> Floats:
        """Compute a number's derivatives with respect to the shape.

        The shape of a cell is its undeformed distance [mm]; heights count with the opposite sign. The derivatives are
        valid while no cell enters or leaves contact, or starts or ceases to be plastic. If a contact cell has no
        pressure, an open cell no gap, or a plastic cell no depth, there are only one-sided derivatives. The contact
        area on cells is piecewise constant and has no derivative.

        Parameters
        ----------
        solution : Solution
            Solution of this problem, grid and communicator.
        of : {"load", "approach"} or ndarray
            ``"load"`` means the load [N] at fixed approach, ``"approach"`` the approach [mm] at fixed load. An array,
            of the local rows or the whole grid, is dJ/dp of a number J(p), where p are the pressures of the cells
            [N/mm2]; then the prescribed quantity of the solution is fixed.

        Returns
        -------
        ndarray of float64, shape (local rows, nx)
            Derivatives [1/mm times the unit of the number]; NaN if the linear solver does not converge.

        Raises
        ------
        InputError
            If `of` is not allowed, or the number has no derivative. The approach has none without elastic contact. In
            full contact of a periodic patch, other numbers have none at a fixed mean gap, and at a fixed approach only
            on a layer on a rigid base.
        """
        self._check_solution(solution)
        g, fixed = call_collectively(self.comm, _read_number, of, solution)
        check_equal_on_ranks(self.comm, (of if isinstance(of, str) else "", fixed), "sensitivity: of")
        cells, grid = find_elastic_cells(solution), self.hierarchy.target.grid
        count = self._sum(cells)
        if not count:
            if g is None:
                raise InputError(
                    "sensitivity: of approach: the solution has no elastic contact, so the load does not change with it"
                )
            return np.zeros(cells.shape)
        if self.hierarchy.target.is_singular and count == grid.n:
            return self._in_full_contact(g, fixed)
        with self._system(cells, SENSITIVITY_RTOL) as solve:
            uniform = self._uniform_compliance if fixed == "approach" else 0.0
            q = solve(1.0) if fixed == "load" or uniform else None
            if g is None:
                return q / self._sum(q)
            y, compliance = solve(g), self.hierarchy.target.compliance
            z = 0.0 if fixed != "mean_gap" or compliance is None else solve(compliance)
        if uniform:
            y -= q * (uniform * self._sum(y) / (grid.n + uniform * self._sum(q)))
        if fixed == "approach":
            return -y
        if fixed == "load":
            return q * (self._sum(y) / self._sum(q)) - y
        return (1 - z) * (self._sum(y) / (grid.n - self._sum(z))) - y

    def _in_full_contact(self, g, fixed):
        """Return the derivatives in full contact of periodic patches.

        `g` is dJ/dp, `fixed` the fixed quantity.
        """
        operator, uniform = self.hierarchy.target, self._uniform_compliance
        if fixed != "load" and not (fixed == "approach" and uniform):
            what = fixed.replace("_", " ")
            raise InputError(f"sensitivity: full contact has no derivatives at a fixed {what}")
        if g is None:
            return np.full(operator.local_shape, 1 / operator.grid.n)
        y = np.array(g, dtype=float)
        mean = self._sum(y) / operator.grid.n
        operator.exact_inverse.apply(y, y)
        return -y - mean / uniform if fixed == "approach" else -y

    def _check_solution(self, solution, name="solution"):
        """Raise InputError unless a Solution is on the target grid. Collective."""
        self._check_open()
        fits = isinstance(solution, Solution) and solution.grid == self.hierarchy.target.grid
        fits = fits and solution.slabs.rows == self.hierarchy.slabs.rows
        if not self.comm.allreduce(fits, MPI.LAND):
            raise InputError(f"{name}: must be a Solution on the same grid and as many ranks")

    @contextmanager
    def _system(self, cells, rtol):
        with (
            self.options.inserted(),
            contact_system(self.hierarchy, self._distances[-1], cells, rtol) as solve,
        ):
            yield solve

    def _stiffness_of(self, cells):
        """Return the stiffness of a set of contact cells [N/mm]. Collective.

        The stiffness is dx dy sum(q), where q is zero outside `cells` and A q = 1 there. The uniform displacement of a
        layer on a rigid base acts as a spring in series with it.
        """
        grid, count = self.hierarchy.target.grid, self._sum(cells)
        uniform = self._uniform_compliance / grid.area
        if not count or (self.hierarchy.target.is_singular and count == grid.n):
            return (1 / uniform if uniform else np.inf) if count else 0.0
        with self._system(cells, RTOL) as solve:
            stiffness = float(grid.cell_area * self._sum(solve(1.0)))
        return stiffness / (1 + uniform * stiffness)

    def _tilt_stiffness_of(self, cells):
        """Return the stiffness matrix of a set of contact cells, shape (3, 3). Collective."""
        grid, slabs = self.hierarchy.target.grid, self.hierarchy.slabs
        if any(grid.repeats):
            raise InputError("tilt_stiffness: bodies on a patch that repeats cannot tilt")
        x, y = grid.x(), grid.y(slabs.rows)
        with self._system(cells, RTOL) as solve:
            fields = [np.broadcast_to(field, cells.shape) for field in (1.0, x, y[:, None])]
            sums = np.stack([linear_sums(solve(field), x, y)[0] for field in fields])
        stiffness = grid.cell_area * np.asarray(sum_over(self.hierarchy.target.comm, sums))
        return (stiffness + stiffness.T) / 2

    def _sum(self, field):
        """Return a field's sum over all cells. Collective."""
        return sum_over(self.hierarchy.target.comm, [np.sum(field)])[0]


def _read_number(of, solution):
    """Return dJ/dp of the number J in `of`, and what is fixed.

    dJ/dp has the local rows. It is None if J is the approach.
    """
    if isinstance(of, str):
        if of == "load":
            return np.full(solution.contact.shape, solution.grid.cell_area), "approach"
        if of == "approach":
            return None, "load"
        raise InputError(f"sensitivity: of {of!r}: must be 'load', 'approach' or an array dJ/dp")
    if solution.prescribed not in ("load", "approach", "mean_gap"):
        raise InputError(f"sensitivity: of an array: not at a prescribed {solution.prescribed}")
    g = real_numbers("sensitivity: of", of, "an array of real numbers, 'load' or 'approach'")
    if g.shape == solution.grid.shape:
        g = g[solution.slabs.rows]
    if g.shape != solution.contact.shape:
        raise InputError(
            f"sensitivity: of: has shape {np.shape(of)}; must be {solution.grid.shape}, or the local rows"
        )
    if not np.isfinite(g[solution.contact]).all():
        raise InputError("sensitivity: of: must be finite in contact")
    return g, solution.prescribed
