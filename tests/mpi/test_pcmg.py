"""The multigrid PC in a KSP of a user's own, on the Mat of an operator without a hierarchy."""

import weakref

import numpy as np
import pytest
from cases import APPROACH, hertz
from mpi4py import MPI
from operators import STEEL, asymmetry, slabs_of
from petsc4py import PETSc
from running import solve

from app import Grid, InputError
from app.base.petsc import calling_petsc
from app.halfspace.operator import InfluenceOperator
from app.multigrid import ContactMG
from app.multigrid.hierarchy import Hierarchy
from app.multigrid.linear_solver import LinearSolver
from app.multigrid.transfer import Transfer
from app.options.solver_options import temporary_options

MULTIGRID = {"pc_type": "python", "pc_python_type": "app.multigrid.ContactMG"}
RTOL = 1e-8
FREE, PERIODIC = (Grid.from_domain(48, 40, (-3, 3, -2.5, 2.5), periodic) for periodic in (False, True))


def contact_sets(grid):
    """An ellipse, and a part of it with a hole."""
    x, y = grid.x()[None, :], grid.y()[:, None]
    ellipse = (x / 2.5) ** 2 + (y / 2) ** 2 < 1
    return ellipse, ellipse & (x > -1) & (x**2 + y**2 > 0.3)


def right_side(operator):
    x, y = operator.grid.x()[None, :], operator.grid.y(operator.slabs.rows)[:, None]
    return (operator.mask * (1 + 0.1 * x + 0.2 * np.sin(3 * x * y))).reshape(-1)


def bare(comm, grid):
    """Make an operator without hierarchy, and its Mat."""
    operator = InfluenceOperator(grid, STEEL, slabs_of(comm, grid), comm if comm.size > 1 else None)
    return operator, operator.mat()


def user_ksp(mat, kind, prefix="user_"):
    ksp = PETSc.KSP().create(mat.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(mat)
    ksp.setType(kind)
    ksp.setTolerances(rtol=RTOL, max_it=60)
    ksp.setNormType(PETSc.KSP.NormType.PRECONDITIONED)
    ksp.setFromOptions()
    return ksp


def with_prefix(prefix, options):
    return {prefix + name: text for name, text in options.items()}


def of_the_loop(grid, kind):
    """Return the iterations of the paper's loop for each contact set, on one rank."""
    hierarchy, counts = Hierarchy(grid, STEEL, MPI.COMM_SELF), []
    options = {"ksp_type": kind, "ksp_norm_type": "preconditioned", "ksp_rtol": str(RTOL), "ksp_max_it": "60"}
    with temporary_options("", {}, options | {"pc_type": "mg"}):
        solver = LinearSolver(hierarchy)
        right = solver.mat.createVecRight()
        for contact in contact_sets(grid):
            hierarchy.target.mask[...] = contact
            solver.set_contact()
            right.setArray(right_side(hierarchy.target))
            counts.append(solver.solve(right, np.inf)[1])
    right.destroy()
    solver.destroy()
    hierarchy.destroy()
    return counts


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize("kind", ["gmres", "cg", "richardson"])
@pytest.mark.parametrize("grid", [FREE, PERIODIC], ids=["free", "periodic"])
def test_ksp_of_a_user_needs_as_many_iterations_as_the_loop(comm, kind, grid):
    operator, mat = bare(comm, grid)
    counts, (p, b) = [], mat.createVecs()
    with temporary_options("", {}, with_prefix("user_", MULTIGRID)):
        ksp = user_ksp(mat, kind)
        for contact, announce in zip(contact_sets(grid), (mat.assemble, mat.stateIncrease), strict=True):
            operator.mask[...] = contact[operator.slabs.rows]
            announce()
            b.setArray(right_side(operator))
            ksp.solve(b, p)
            assert ksp.getConvergedReason() > 0
            counts.append(ksp.getIterationNumber())
            residual = b.duplicate()
            mat.mult(p, residual)
            residual.aypx(-1, b)
            assert residual.norm() < 100 * RTOL * b.norm()
            residual.destroy()
    assert counts == of_the_loop(grid, kind)
    for part in (ksp, p, b, mat):
        part.destroy()


def ready(comm, grid=FREE):
    """Make a KSP with the PC, set in code, and its operator, Mat and Vecs, for the first contact set."""
    operator, mat = bare(comm, grid)
    operator.mask[...] = contact_sets(grid)[0][operator.slabs.rows]
    mat.assemble()
    p, b = mat.createVecs()
    b.setArray(right_side(operator))
    ksp = PETSc.KSP().create(mat.comm)
    ksp.setOperators(mat)
    ksp.setType("gmres")
    ksp.setTolerances(rtol=RTOL)
    ksp.getPC().setType("python")
    ksp.getPC().setPythonContext(ContactMG())
    return operator, ksp, (mat, p, b)


@pytest.mark.mpi(1, 2)
def test_cycle_is_symmetric_for_a_ksp_that_needs_it(comm):
    """The type may be an option, set in code, or changed."""
    operator, ksp, (mat, p, b) = ready(comm)
    ksp.solve(b, p)
    assert asymmetry(ksp.getPC(), operator, mat) > 1e-4
    ksp.setType("cg")
    ksp.solve(b, p)
    assert asymmetry(ksp.getPC(), operator, mat) < 1e-14
    with temporary_options("", {}, with_prefix("user_", MULTIGRID | {"ksp_type": "minres"})):
        other = user_ksp(mat, "gmres")
        other.setUp()
    assert asymmetry(other.getPC(), operator, mat) < 1e-14
    for part in (other, ksp, mat, p, b):
        part.destroy()


CYCLES = [{}, {"pc_mg_cycle_type": "w"}, {"pc_mg_type": "additive"}, {"pc_mg_levels": "1"}]
AFTER = {"ksp_type": "richardson", "ksp_max_it": "2", "pc_type": "sor", "pc_sor_backward": ""}
DISTINCT = {"pc_mg_distinct_smoothup": "", "mg_levels_1_up_pc_sor_omega": "0.5"} | with_prefix(
    "mg_levels_up_", AFTER
)


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize("options", [*CYCLES, DISTINCT, {"mg_levels_ksp_max_it": "2"}])
def test_transpose_is_the_adjoint_of_the_cycle(comm, options):
    """Also on the next contact set."""
    operator, ksp, (mat, p, b) = ready(comm)
    pc, vectors = ksp.getPC(), [mat.createVecRight() for _ in range(4)]
    u, v, mu, tv = vectors
    rng = np.random.default_rng(comm.rank)
    with temporary_options("", {}, options):
        for _ in range(2):
            for vec in (u, v):
                vec.setArray((rng.normal(size=operator.local_shape) * operator.mask).reshape(-1))
            pc.setUp()
            pc.apply(u, mu)
            pc.applyTranspose(v, tv)
            assert u.dot(tv) == pytest.approx(mu.dot(v), abs=1e-13 * mu.norm() * v.norm())
            operator.mask[...] = contact_sets(FREE)[1][operator.slabs.rows]
            mat.assemble()
    for part in (ksp, mat, p, b, *vectors):
        part.destroy()


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize("kind", ["bicg", "cgne", "lsqr", "transpose"])
def test_methods_that_multiply_by_the_transpose(comm, kind):
    _, ksp, (mat, p, b) = ready(comm)
    if kind != "transpose":
        ksp.setType(kind)
    (ksp.solveTranspose if kind == "transpose" else ksp.solve)(b, p)
    assert ksp.getConvergedReason() > 0
    residual = b.duplicate()
    mat.mult(p, residual)
    residual.aypx(-1, b)
    assert residual.norm() < 1000 * RTOL * b.norm()
    for part in (ksp, mat, p, b, residual):
        part.destroy()


@pytest.mark.mpi(1, 2)
def test_options_are_read_under_the_prefix_of_the_pc(comm):
    """Two solvers of one program have different cycles; the user's options stay."""
    operator, ksp, parts = ready(comm)
    mat, p, b = parts
    options = {"pc_mg_levels": "3", "mg_levels_pc_sor_omega": "1", "mg_levels_ksp_max_it": "2"}
    given = with_prefix("user_", MULTIGRID | options) | with_prefix(
        "other_", MULTIGRID | {"pc_mg_cycle_type": "w"}
    )
    counts = []
    with temporary_options("", {}, given):
        for prefix in ("user_", "other_"):
            other = user_ksp(mat, "gmres", prefix)
            other.solve(b, p)
            counts.append(other.getIterationNumber())
            context = other.getPC().getPythonContext()
            assert len(context.operators) == (3 if prefix == "user_" else 5)
            other.destroy()
        database = PETSc.Options()
        assert {name: database.getString(name, "") for name in given} == given
    ksp.solve(b, p)
    assert counts[0] < ksp.getIterationNumber()
    for part in (ksp, *parts):
        part.destroy()


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize(
    ("grid", "levels", "message"),
    [
        (FREE, "9", "-pc_mg_levels 9: this grid allows 1 to 5"),
        (FREE, "0", "-pc_mg_levels 0: this grid allows 1 to 5"),
        (Grid(1, 1, 0.1, 0.1), "1", "the grid 1,1 cannot be halved; it must have at least 2 cells"),
    ],
)
def test_invalid_numbers_of_levels_are_refused(comm, grid, levels, message):
    _, ksp, parts = ready(comm, grid)
    with (
        temporary_options("", {}, {"pc_mg_levels": levels}),
        pytest.raises(InputError, match=message),
        calling_petsc(),
    ):
        ksp.setUp()
    for part in (ksp, *parts):
        part.destroy()


@pytest.mark.mpi(1, 2)
def test_a_scaled_mat_is_refused(comm):
    _, ksp, parts = ready(comm)
    parts[0].scale(2.0)
    message = "ContactMG: needs a Mat that is neither scaled nor shifted"
    with pytest.raises(InputError, match=message), calling_petsc():
        ksp.setUp()
    for part in (ksp, *parts):
        part.destroy()


@pytest.mark.mpi(1)
@pytest.mark.parametrize("call", [1, 2, 5, 9])
@pytest.mark.parametrize(
    "place",
    [
        (InfluenceOperator, "mult"),
        (InfluenceOperator, "SOR"),
        (Transfer, "restrict_defect"),
        (Transfer, "add_copies"),
    ],
    ids=lambda place: place[1],
)
def test_an_interrupted_cycle_can_be_repeated(comm, place, call, monkeypatch):
    operator, ksp, (mat, p, b) = ready(comm)
    ksp.solve(b, p)
    expected, calls, plain = ksp.getIterationNumber(), [], getattr(*place)

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return plain(*arguments)

    p.set(0)
    with monkeypatch.context() as patch:
        patch.setattr(*place, interrupted)
        with pytest.raises(KeyboardInterrupt), calling_petsc():
            ksp.solve(b, p)
    ksp.reset()
    ksp.setOperators(mat)
    p.set(0)
    ksp.solve(b, p)
    assert ksp.getConvergedReason() > 0 and ksp.getIterationNumber() == expected
    gone = weakref.ref(operator)
    for part in (ksp, mat, p, b):
        part.destroy()
    del operator, ksp, mat, p, b
    PETSc.garbage_cleanup()
    assert gone() is None  # without Python's collector of cycles


@pytest.mark.mpi(2)
def test_coarsest_grid_of_many_cells_or_ranks_is_refused(comm):
    for n, levels, message in (
        (128, 2, "64 x 64 cells is too large"),
        (64, 3, "16 x 16 cells is on 2 ranks"),
    ):
        with pytest.raises(InputError, match=f"a coarsest grid of {message}"):
            solve(hertz(n), APPROACH, "mg_v11", pc_mg_levels=levels, lcp_cells_per_rank=1)


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize("method", ["fmg_v11", "fmg_fft"])
def test_multigrid_with_one_level_is_its_smoother(comm, method):
    """It needs no matrix, so the grid may be large."""
    one_level = solve(hertz(96), APPROACH, method, pc_mg_levels=1, lcp_max_it=300)
    assert one_level.converged
    assert one_level.iterations > 2 * solve(hertz(96), APPROACH, method).iterations


OF_DEFAULT_METHODS = [
    ("mg_coarse_pc", "free.circulant.Circulant"),
    ("mg_coarse_sub_pc", "free.circulant.Circulant"),
    ("mg_coarse_ksp", "free.tracking_cg.TrackingCG"),
    ("pc", "periodic.two_grid.TwoGrid"),
]


@pytest.mark.mpi(1, 2)
@pytest.mark.parametrize(("place", "solver"), OF_DEFAULT_METHODS)
def test_solvers_of_default_methods_refuse_other_systems(comm, place, solver):
    options = {f"{place}_type": "python", f"{place}_python_type": f"app.methods.{solver}"}
    with pytest.raises(InputError, match=f"{solver.split('.')[-1]}: needs an In"):
        solve(hertz(32), APPROACH, "fmg_v11", **options)
