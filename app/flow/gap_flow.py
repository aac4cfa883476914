"""Flow through a gap: linear solves by PETSc, bounds, results."""

import re

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError, format_exact
from app.base.petsc import calling_petsc, error_message, synchronized, to_input_error
from app.flow.conserving_flux import FluxRepair
from app.flow.network import Network
from app.flow.percolation import find_percolating_sets
from app.flow.results import DirectedFlow, Flow
from app.flow.two_grid import TwoGrid
from app.halfspace.grid import Grid
from app.options.solver_options import is_used, temporary_options
from app.parallel.reductions import minimum_over
from app.parallel.slabs import Slabs, none_if_single

PREFIX = "flow_"
MAX_ERROR = 1e-4  # of the flow rate; if the bounds differ by more, the linear solve continues
_RTOL = 3e-5  # of the linear solve, in its energy norm
_SOLVES = 10  # largest number of linear solves
_NARROW = 1e-8  # part of the flow rate that the faces may contribute which the lower bound leaves out
_PRINTS = re.compile("view|monitor|reason")
_DEFAULTS = {"ksp_type": "cg", "ksp_norm_type": "natural", "ksp_converged_use_initial_residual_norm": ""}
if PETSc.Sys.hasExternalPackage("hypre"):  # its default smoother sweeps forwards and backwards on each level
    _SMOOTHERS = {"relax_type_down": "SOR/Jacobi", "relax_type_up": "backward-SOR/Jacobi"}
    _DEFAULTS |= {"pc_type": "hypre"} | {
        f"pc_hypre_boomeramg_{name}": _SMOOTHERS[name] for name in _SMOOTHERS
    }
else:
    _DEFAULTS |= {"pc_type": "gamg", "pc_gamg_threshold": "0.02"}


def set_options(options):
    """Set options, with their prefix, in PETSc's database; InputError if PETSc does not use one.

    They are tried on a small gap, except those that print.
    """
    database, grid = PETSc.Options(), Grid(4, 4, 1.0, 1.0)
    for name in options:
        database.delValue(name)  # so that it is seen whether the trial uses it
    tried = {name: text for name, text in options.items() if not _PRINTS.search(name)}
    with temporary_options("", {}, tried):
        solve_flow(1.0 + np.arange(grid.n).reshape(grid.shape) % 3, np.ones(grid.shape, bool), grid)
        unused = [name for name in tried if not is_used(name)]
    if unused:
        raise InputError(f"-{unused[0]}: PETSc does not use this option")
    for name, text in options.items():
        database.setValue(name, text or None)


@synchronized
def solve_flow(gap, is_open, grid, slabs=None, comm=None):
    """Solve for the flow through a gap, along x and along y. Collective.

    The options of the linear solver are those in PETSc's database with the prefix `PREFIX`.

    Parameters
    ----------
    gap : ndarray of float64, shape (local rows, nx)
        Gap [mm]; it is used in open cells only.
    is_open : ndarray of bool, shape (local rows, nx)
        Cells through which fluid may flow. Cells without a positive gap are closed in any case.
    grid : Grid
    slabs, comm : Slabs, mpi4py communicator, optional
        Distribution of the rows; by default this rank has all rows.

    Returns
    -------
    Flow

    Raises
    ------
    InputError
        If PETSc refuses an option.
    """
    comm, slabs = none_if_single(comm), slabs or Slabs(grid.ny)
    is_open = is_open & (gap > 0)
    highest = float(-minimum_over(comm, [-gap[is_open].max(initial=0.0)])[0])
    # Of relative gaps. Gaps are closed if the reciprocal of the cube might overflow.
    cubes = (np.where(is_open, gap, 0.0) / (highest or 1.0)) ** 3
    flows = []
    with temporary_options(PREFIX, _DEFAULTS, {}), calling_petsc(), _PressureSolver() as solver:
        for along in "xy":
            sets, count = find_percolating_sets(cubes > 1e-300, grid, along, slabs, comm)
            if not count:
                flows.append(DirectedFlow(0.0, 0.0, np.full(gap.shape, np.nan), *np.zeros((2, *gap.shape))))
                continue
            network = Network(np.where(sets > 0, cubes, 0.0), grid, along, slabs, comm)
            pressure, lower, upper, fluxes = solver.solve(network, sets, count)
            length, width = grid.sides if along == "x" else grid.sides[::-1]
            unit = highest**3 / 12
            # The flux of the solution has the flow rate. A flux with this rate has an error of second order.
            rate = unit * ((lower + upper) / 2 / network.rate(fluxes) if lower else 1.0)
            flux_x, flux_y = fluxes[0] * (rate / grid.dy), fluxes[1] * (rate / grid.dx)
            means = (flux_x[:, :-1] + flux_x[:, 1:]) / 2, (flux_y[:-1] + flux_y[1:]) / 2
            bounds = unit * length / width * lower, unit * length / width * upper
            flows.append(DirectedFlow(*bounds, np.where(sets > 0, pressure, np.nan), *means))
    return Flow(*flows)


class _PressureSolver:
    """Linear solver (KSP) and flux repair of a network, destroyed after a ``with`` block.

    Both directions of a periodic patch have the same matrix, if the same cells percolate.
    """

    _network, _parts, _context = None, (), None  # KSP, vectors x and b, matrix; TwoGrid

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        for part in self._parts:
            part.destroy()
        if self._context:
            self._context.free()
        if isinstance(error, PETSc.Error):
            raise to_input_error(error) from None

    def _set_up(self, network, sets, count):
        self.__exit__(None, None, None)
        self._ties, comm = network.tie(sets, count), network.comm or PETSc.COMM_SELF
        self._context = context = TwoGrid(network, self._ties, PREFIX)
        sizes = network.is_open.size, network.grid.n
        matrix, ksp = PETSc.Mat().createPython((sizes, sizes), context, comm=comm), PETSc.KSP().create(comm)
        matrix.setUp()
        x, b = matrix.createVecs()
        self._parts, self._network, self._repair = (ksp, x, b, matrix), network, None
        ksp.setOptionsPrefix(PREFIX)
        ksp.setOperators(matrix)
        ksp.getPC().setOptionsPrefix(f"{PREFIX}cells_")  # its options are those of the coarse matrix
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(context)
        ksp.setInitialGuessNonzero(True)
        ksp.setConvergenceTest(self._test)
        try:
            ksp.setFromOptions()
            context.solver.setFromOptions()
        except PETSc.Error as error:
            raise InputError(f"solver options: {error_message(error)}") from None
        if not 0 <= ksp.rtol < np.inf:
            raise InputError(
                f"solver options: -{PREFIX}ksp_rtol {format_exact(ksp.rtol)}: must be at least 0"
            )

    def _test(self, ksp, _, norm):
        """Return PETSc's reason to stop, or None. Collective."""
        if not norm < np.inf:
            return PETSc.KSP.ConvergedReason.DIVERGED_NANORINF
        if norm > self._rtol * self._energy**0.5:
            return None
        pressure = ksp.getSolution().getArray(readonly=True).reshape(self._ties.shape)
        self._energy = self._network.energy(pressure)  # has become smaller
        return PETSc.KSP.ConvergedReason.CONVERGED_ATOL if norm <= self._rtol * self._energy**0.5 else None

    def solve(self, network, sets, count):
        """Return pressure, both bounds of the flow rate, and conserving fluxes. Collective.

        In the energy norm, the square of the error is the energy of the pressure minus the flow rate. So the tolerance
        is relative to the root of the energy. It is made stricter if the bounds are not close enough, unless the user
        has set it.
        """
        if self._network is None or not network.has_conductances_of(self._network):
            self._set_up(network, sets, count)
        ksp, x, b, _ = self._parts
        options, start, self._network = PETSc.Options(PREFIX), network.linear_pressure(), network
        b.setArray(network.excess(network.fluxes(np.zeros(start.shape))) + self._ties * start)
        x.setArray(start)
        self._rtol, is_fixed = options.getReal("ksp_rtol", _RTOL), options.hasName("ksp_rtol")
        self._energy, lower, upper = network.energy(start), 0.0, np.inf
        for _ in range(_SOLVES):
            ksp.solve(b, x)
            pressure = x.getArray().reshape(start.shape)
            if not (energy := network.energy(pressure)) < np.inf:  # the linear solver has failed
                pressure, energy = start, network.energy(start)
            lowest = _NARROW * energy / (2 * network.grid.n)
            if self._repair is None or self._repair.lowest > 100 * lowest:
                self._repair = FluxRepair(network, lowest)
            fluxes, bound = self._repair.conserving_fluxes(network, pressure)
            difference, lower, upper = upper - lower, max(lower, bound), min(upper, energy)
            if is_fixed or upper - lower <= MAX_ERROR * upper or upper - lower > difference / 2:
                break
            self._rtol /= 10
        return pressure.copy(), lower, upper, fluxes
