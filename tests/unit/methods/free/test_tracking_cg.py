"""TrackingCG against PETSc's CG, from a known displacement."""

from functools import partial

import numpy as np
import pytest
from operators import STEEL
from petsc4py import PETSc

from app import Grid, Material
from app.halfspace.operator import InfluenceOperator
from app.methods.free.circulant import circulant_inverse
from app.methods.free.tracking_cg import TrackingCG
from app.methods.multilevel_operators import multilevel_influence
from app.options.solver_options import temporary_options

GRID = Grid(30, 20, 0.3, 0.2)  # products by FFT


class Jacobi:
    """Preconditioner of a user: a diagonal."""

    def apply(self, pc, x, y):
        size = x.getLocalSize()
        y.setArray(x.getArray(readonly=True) * np.linspace(1.0, 3.0, size))


class Identity:
    """Preconditioner in the operator's precision."""

    def precondition(self, r, z, reduced):
        z[...] = r

    def local_terms(self, q):
        return []


class System:
    """System C A C x = C b with TrackingCG or PETSc's CG."""

    def __init__(self, kind="tracking", dtype=np.float64, share=0.5, grid=GRID, pc=None):
        self.operator = operator = InfluenceOperator(grid, STEEL, dtype=dtype)
        rng = np.random.default_rng(1)
        operator.mask[...] = rng.random(grid.shape) < share
        operator.mask_changed()
        self.mat = operator.mat(PETSc.COMM_SELF)
        self.x, self.b = self.mat.createVecs()
        self.ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self.ksp.setOperators(self.mat)
        self.ksp.setType(PETSc.KSP.Type.PYTHON if kind == "tracking" else PETSc.KSP.Type.CG)
        if kind == "tracking":
            self.cg = TrackingCG()
            self.ksp.setPythonContext(self.cg)
        self.ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        if pc is None:
            self.ksp.getPC().setType(PETSc.PC.Type.NONE)
        else:
            self.ksp.getPC().setType(PETSc.PC.Type.PYTHON)
            self.ksp.getPC().setPythonContext(pc)
        self.set_right(rng.normal(size=grid.shape))

    def set_right(self, values):
        """Set b; PETSc's CG needs b = 0 outside C."""
        is_tracking = self.ksp.getType() == PETSc.KSP.Type.PYTHON
        values = values if is_tracking else values * self.operator.mask
        self.b.setArray(values.reshape(-1))

    def solve(self, **tolerances):
        self.ksp.setTolerances(**tolerances)
        self.ksp.setConvergenceHistory(reset=True)
        self.ksp.solve(self.b, self.x)
        return self.ksp.getConvergenceHistory().copy()

    def track(self, x=None):
        """Set x and its displacement."""
        self.ksp.setUp()
        self.ksp.setInitialGuessNonzero(True)
        if x is not None:
            self.x.setArray((x * self.operator.mask).reshape(-1))
        self.u = self.product()
        self.cg.displacement = self.u

    def product(self):
        """Return A x in double precision."""
        u = np.empty(self.operator.local_shape)
        self.operator.exact_displacement(self.solution, u)
        return u

    @property
    def solution(self):
        return self.x.getArray(readonly=True).reshape(self.operator.local_shape).copy()

    def destroy(self):
        for part in (self.ksp, self.mat, self.x, self.b):
            part.destroy()


@pytest.fixture
def make():
    systems = []

    def system(*arguments, **how):
        systems.append(System(*arguments, **how))
        return systems[-1]

    yield system
    for one in systems:
        one.destroy()


def random_field(seed=7):
    return np.random.default_rng(seed).normal(size=GRID.shape)


@pytest.mark.parametrize("share", [0.02, 0.5, 1.1])
@pytest.mark.parametrize("pc", [None, Jacobi])
def test_residuals_are_those_of_petsc_cg(make, share, pc):
    ours, petscs = (make(kind, share=share, pc=pc and pc()) for kind in ("tracking", "petsc"))
    histories = [system.solve(rtol=1e-8, max_it=500) for system in (ours, petscs)]
    assert ours.ksp.getConvergedReason() == petscs.ksp.getConvergedReason() > 0
    # Rounding grows by a factor of ten a step, in any CG: after some 15 steps two of them need not be alike.
    assert 3 < len(histories[0]) <= len(histories[1]) + 1 <= len(histories[0]) + 2
    np.testing.assert_allclose(histories[0][:12], histories[1][:12], rtol=1e-7, atol=1e-12)
    # The norm is not summed in every step: of its eight digits that may be lost, some are.
    np.testing.assert_allclose(histories[0][:6], histories[1][:6], rtol=1e-8)
    scale = abs(petscs.solution).max()
    np.testing.assert_allclose(ours.solution, petscs.solution, rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize(
    ("tolerances", "reason"),
    [
        ({"rtol": 0.1, "atol": 0}, PETSc.KSP.ConvergedReason.CONVERGED_RTOL),
        ({"rtol": 0, "atol": 3.0}, PETSc.KSP.ConvergedReason.CONVERGED_ATOL),
        ({"rtol": 1e-30, "atol": 0, "max_it": 7}, PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT),
        ({"rtol": 0, "atol": 0, "divtol": 1.0001}, PETSc.KSP.ConvergedReason.DIVERGED_DTOL),
    ],
    ids=["rtol", "atol", "max_it", "divtol"],
)
def test_convergence_test_is_that_of_petsc(make, tolerances, reason):
    ours, petscs = make("tracking"), make("petsc")
    for system in (ours, petscs):
        if "divtol" in tolerances:  # a residual that grows first: mostly in what A hardly sees
            j, i = np.indices(GRID.shape)
            system.set_right((-1.0) ** (i + j) + 0.3)
        system.solve(**tolerances)
    assert ours.ksp.getConvergedReason() == petscs.ksp.getConvergedReason() == reason
    assert ours.ksp.getIterationNumber() == petscs.ksp.getIterationNumber()


def test_convergence_test_of_the_caller_is_called(make):
    system = make()
    calls = []

    def test(ksp, iteration, norm):
        calls.append((iteration, norm))
        return PETSc.KSP.ConvergedReason.CONVERGED_HAPPY_BREAKDOWN if iteration == 3 else 0

    system.ksp.setConvergenceTest(test)
    history = system.solve()
    assert system.ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.CONVERGED_HAPPY_BREAKDOWN
    assert [iteration for iteration, _ in calls] == [0, 1, 2, 3]
    assert [norm for _, norm in calls] == history.tolist()
    assert history[-1] == system.cg.residual == system.ksp.getResidualNorm()


@pytest.mark.parametrize(("dtype", "off"), [(np.float64, 1e-13), (np.float32, 3e-6)])
def test_solve_starts_from_the_displacement_and_returns_the_change(make, dtype, off):
    system = make(dtype=dtype)
    system.track(random_field())
    before = system.solution
    system.solve(rtol=1e-5)
    change, inside = system.cg.change, system.operator.mask
    assert change.dtype == dtype
    np.testing.assert_allclose(system.solution - before, change, rtol=0, atol=1e-15 * abs(before).max())
    of_change = np.empty(GRID.shape)
    system.operator.exact_displacement(change.astype(float), of_change)
    assert abs(system.u + of_change - system.product()).max() < off * abs(system.product()).max()
    right = system.b.getArray(readonly=True).reshape(inside.shape)
    assert system.cg.residual == pytest.approx(np.linalg.norm((right - system.product())[inside]), rel=0.01)


@pytest.mark.parametrize("unit", [1e-22, 1.0, 1e22])
def test_single_precision_solves_to_its_rounding_in_any_unit(make, unit):
    other, usual = (make(dtype=dtype, pc=Identity()) for dtype in (np.float32, np.float64))
    other.set_right(unit * np.random.default_rng(2).normal(size=GRID.shape))
    usual.set_right(np.random.default_rng(2).normal(size=GRID.shape))
    for system in (usual, other):
        system.solve(rtol=1e-5)
        assert system.ksp.getConvergedReason() > 0
    assert abs(other.ksp.getIterationNumber() - usual.ksp.getIterationNumber()) <= 1
    np.testing.assert_allclose(
        other.solution, unit * usual.solution, rtol=0, atol=1e-3 * other.solution.max()
    )


def test_right_hand_side_is_unchanged_and_read_on_contact_only(make):
    system = make()
    before = system.b.getArray(readonly=True).copy()
    state = system.b.stateGet()
    system.solve(rtol=1e-6)
    assert system.b.stateGet() == state
    np.testing.assert_array_equal(system.b.getArray(readonly=True), before)
    first = system.solution
    assert (first[~system.operator.mask] == 0).all()
    system.set_right(np.where(system.operator.mask, before.reshape(GRID.shape), 1e6))
    system.solve(rtol=1e-6)
    np.testing.assert_array_equal(system.solution, first)


def test_empty_contact_set_needs_no_iteration(make):
    system = make(share=-1)
    assert system.solve(rtol=1e-6).tolist() == [0.0]
    assert system.ksp.getConvergedReason() > 0
    assert not system.solution.any()


def test_indefinite_operator_is_reported(make):
    system = make()
    displacement = system.operator.displacement

    def negative(p, u):
        displacement(p, u)
        np.negative(u, out=u)

    system.ksp.setUp()
    system.cg.multiply = negative
    system.solve(rtol=1e-6)
    assert system.ksp.getConvergedReason() == PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT


def test_norm_has_the_digits_of_the_residual(make):
    """A given norm is in double precision, the residual of a cell is not."""
    system = make(dtype=np.float32, share=-1, pc=Identity())
    system.operator.mask[3, 4] = True
    system.operator.mask_changed()
    system.track()
    system.set_right(0.7 * system.operator.mask)
    system.cg.first_norm = 0.7  # more than single precision has of it
    assert system.solve(rtol=0.06)[-1] <= 1e-7
    assert system.ksp.getIterationNumber() == 1


def test_flops_of_tracking_cg_are_logged(make):
    """A step of CG has at least ten per cell, in addition to the product."""
    system = make(share=1.1)
    before = PETSc.Log.getFlops()
    steps = len(system.solve(rtol=1e-6)) - 1
    flops = PETSc.Log.getFlops() - before - steps * system.operator.product.flops
    assert 10 * steps * GRID.n <= flops <= 30 * steps * GRID.n


@pytest.mark.parametrize("norm", [None, "preconditioned"])
def test_norm_type_is_unpreconditioned_unless_an_option_names_another(make, norm):
    system, unpreconditioned = make(), PETSc.KSP.NormType.UNPRECONDITIONED
    system.ksp.setNormType(PETSc.KSP.NormType.PRECONDITIONED)
    with temporary_options("", {}, {"ksp_norm_type": norm}):
        system.ksp.setFromOptions()
    assert (system.ksp.getNormType() == unpreconditioned) == (norm is None)


def test_solve_works_after_a_reset(make):
    system = make()
    norms = system.solve(rtol=1e-6)
    system.ksp.reset()
    assert system.cg.work is None
    system.ksp.setOperators(system.mat)
    system.x.set(0)
    assert system.solve(rtol=1e-6) == pytest.approx(norms)


@pytest.mark.parametrize(
    "grid",
    [
        Grid(640, 640, 1.0, 1.0),
        *(
            Grid(nx, ny, 1.0, 1.0, periodic=periodic)
            for nx, ny in ((33, 31), (200, 9))
            for periodic in ("", "x", "y")
        ),
        *(Grid(140, 130, 1.0, 1.0, periodic=periodic) for periodic in "xy"),
    ],
)
def test_operators_leave_spare_fields_unchanged(grid):
    """CG's vectors are in storage that products leave unused, also those of stiff layers, which are padded."""
    kernel = Material.coated((5.0, 1.0), (0.3, 0.3), 3.0).kernel
    operator = InfluenceOperator(grid, kernel, dtype=np.float32)
    operator.prepare("exact_product", "product")
    spare = [field for field in operator.spare_fields(np.float64, np.float32) if field is not None]
    assert spare
    for field in spare:
        field[...] = 7.0
    p = np.ones(operator.local_shape, np.float32)
    for create in (
        circulant_inverse,
        partial(circulant_inverse, apart=True, padded=True),
        multilevel_influence,
    ):
        if (multiplier := create(operator)) is not None:
            multiplier.apply(p, p)
    assert all((field == 7.0).all() for field in spare)
