"""Preconditioner of the default method."""

import numpy as np
import pytest
from mpi4py import MPI
from operators import GRIDS, PERIODIC, STEEL
from petsc4py import PETSc

from app import Material
from app.base.petsc import calling_petsc
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.kernel import UNIT
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.operator import InfluenceOperator
from app.methods.free.circulant import Circulant, circulant_inverse
from app.methods.free.tracking_cg import TrackingCG
from app.options.solver_options import SolverOptions
from app.parallel.communicator import Communicator
from app.parallel.slabs import Slabs

SMALL = {name: grid for name, grid in (GRIDS | PERIODIC).items() if grid.n <= 500}


def preconditioner(operator, **options):
    """Return a PC and its matrix (cells, cells of C)."""
    mat = operator.mat(PETSc.COMM_SELF)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(Circulant())
    with SolverOptions("", {name: str(value) for name, value in options.items()}).inserted(), calling_petsc():
        pc.setFromOptions()
        pc.setUp()
    x, y = mat.createVecs()
    columns = []
    for cell in np.flatnonzero(operator.mask):
        x.set(0)
        x.setValue(int(cell), 1.0)
        x.assemble()
        pc.apply(x, y)
        columns.append(y.getArray(readonly=True).copy())
    for part in (pc, mat, x, y):
        part.destroy()
    return np.array(columns).T.reshape(operator.grid.n, -1)


SYSTEMS = [*((grid, steps, 0) for grid in SMALL.values() for steps in (0, 1, 3))]
SYSTEMS += [(Grid(19, 17, 1.0, 0.8), steps, 2) for steps in (0, 2)]


@pytest.mark.parametrize(("grid", "steps", "blocks"), SYSTEMS)
def test_preconditioner_is_symmetric_positive_definite_on_contact(grid, steps, blocks):
    operator = InfluenceOperator(grid, STEEL)
    rng, rounding = np.random.default_rng(grid.n + steps), 1e-6 if blocks else 1e-12  # of block means: single
    for share in (0.05, 0.4, 1.1):
        operator.mask[...] = rng.random(grid.shape) < share
        operator.mask[0, 0] = True  # some cell
        operator.mask_changed()
        matrix = preconditioner(operator, pc_circulant_extend=steps, pc_circulant_blocks=blocks)
        inside = operator.mask.reshape(-1)
        assert (matrix[~inside] == 0).all()
        on_c = matrix[inside]
        np.testing.assert_allclose(on_c, on_c.T, rtol=0, atol=rounding * abs(on_c).max())
        assert np.linalg.eigvalsh((on_c + on_c.T) / 2)[0] > 0
        if blocks and share < 1:
            assert abs(matrix - preconditioner(operator, pc_circulant_extend=steps)).max() > 0


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_block_means_follow_the_residual_of_cg(monkeypatch, dtype):
    """Means by recurrence equal those of the residual."""
    grid, differences = Grid(64, 48, 1.0, 1.0), []
    precondition = Circulant.precondition

    def compare(self, r, z, reduced=None):
        assert reduced is not None or not differences or ksp.its == 0
        expected = np.empty_like(z)
        precondition(self, r, z, reduced)
        means = self.average._means
        precondition(self, r, expected)
        self.average._means = means
        inside = self.operator.mask
        differences.append(abs(z - expected)[inside].max() / abs(expected)[inside].max())

    comm = Communicator(MPI.COMM_SELF.Dup())
    operator = InfluenceOperator(grid, STEEL, Slabs(grid.ny), comm, dtype)
    operator.mask[...] = np.random.default_rng(4).random(grid.shape) < 0.3
    operator.mask_changed()
    mat = operator.mat(PETSc.COMM_SELF)
    x, b = mat.createVecs()
    b.setArray(np.random.default_rng(5).normal(size=grid.n))
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    choice = {"pc_circulant_extend": "2", "pc_circulant_blocks": "4"}
    with SolverOptions("", choice).inserted():
        ksp.setOperators(mat)
        ksp.setType(PETSc.KSP.Type.PYTHON)
        ksp.setPythonContext(TrackingCG())
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(Circulant())
        ksp.setTolerances(rtol=1e-4)
        ksp.setFromOptions()
        ksp.setUp()
    monkeypatch.setattr(Circulant, "precondition", compare)
    for _ in range(2):  # nothing is left of the first solve
        ksp.solve(b, x)
    assert ksp.getConvergedReason() > 0
    assert len(differences) > 10
    assert max(differences) < 1e-5
    for part in (ksp, mat, x, b):
        part.destroy()
    operator.free()
    comm.Free()


@pytest.mark.parametrize(("periodic", "blocks"), [("", -1), ("spectral", 2)])
def test_impossible_blocks_raise(periodic, blocks):
    operator = InfluenceOperator(Grid(32, 32, 1.0, 1.0, periodic=periodic), STEEL)
    operator.mask[...] = True
    with pytest.raises(Exception, match=f"-pc_circulant_blocks {blocks}: allowed: from 0"):
        preconditioner(operator, pc_circulant_blocks=blocks)


def test_options_are_read_and_reset_forgets_the_operator():
    operator = InfluenceOperator(Grid(16, 16, 1.0, 1.0), STEEL)
    mat, pc = operator.mat(PETSc.COMM_SELF), PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(circulant := Circulant())
    with SolverOptions("", {"pc_circulant_extend": "3"}).inserted():
        pc.setUp()
        assert circulant.extension.steps == 0
        pc.setFromOptions()
    mat.stateIncrease()
    pc.setUp()
    assert circulant.extension.steps == 3 and circulant.operator is operator
    pc.reset()
    assert circulant.operator is None
    for part in (pc, mat):
        part.destroy()


def test_preconditioned_eigenvalues_are_clustered():
    """Eigenvalues of B A are clustered on any grid."""
    spreads = []
    for n in (8, 16, 28):
        grid = Grid(n, n, 1.0 / n, 1.0 / n)
        operator = InfluenceOperator(grid, STEEL)
        y, x = np.mgrid[:n, :n] + 0.5 - n / 2
        operator.mask[...] = x**2 + y**2 < (0.4 * n) ** 2
        operator.mask_changed()
        inside = operator.mask.reshape(-1)
        a = dense_matrix(grid, STEEL)[np.ix_(inside, inside)]
        b = preconditioner(operator, pc_circulant_extend=3)[inside]
        factor = np.linalg.cholesky((b + b.T) / 2)
        values = np.linalg.eigvalsh(factor.T @ a @ factor)
        spreads.append(values[-1] / values[0])
    assert max(spreads) < 5
    assert np.linalg.cond(a) > 20


def test_apply_inverse_inverts_the_circulant():
    grid = GRIDS["even"]
    operator = InfluenceOperator(grid, STEEL)
    multiplier, x = circulant_inverse(operator), np.random.default_rng(1).normal(size=grid.shape)
    assert multiplier.periods == grid.shape  # whose prime factors are small
    y, back = np.empty(grid.shape), np.empty(grid.shape)
    multiplier.apply(x, y)
    multiplier.apply_inverse(y, back)
    np.testing.assert_allclose(back, x, rtol=0, atol=1e-12 * abs(x).max())
    assert circulant_inverse(operator) is multiplier  # made once
    assert circulant_inverse(operator, apart=True) is not multiplier


def test_periodic_neighbours_may_cancel():
    operator = InfluenceOperator(Grid(2, 2, 1.0, 1.0, periodic="spectral"), UNIT)
    stencil = circulant_inverse(operator).centre
    assert stencil.sum() == stencil[1, 1]
    operator.mask[...] = [[True], [False]]
    operator.mask_changed()
    with np.errstate(divide="raise", invalid="raise"):
        assert np.isfinite(preconditioner(operator)).all()


@pytest.mark.parametrize("n", [16, 24])
def test_contact_at_opposite_edges_is_separated(n):
    """CG steps grow with the root of the condition number."""
    grid = Grid(n, n, 0.1, 0.1)
    operator = InfluenceOperator(grid, STEEL)
    operator.mask[...] = True
    dense, conditions = dense_matrix(grid, STEEL), []
    for apart in (False, True):
        inverse = circulant_inverse(operator, apart)
        columns = np.eye(grid.n).reshape(-1, n, n)
        for column in columns:
            inverse.apply(column, column)
        values = np.linalg.eigvals(columns.reshape(grid.n, grid.n) @ dense).real
        conditions.append(values.max() / values.min())
    assert conditions[1] < 0.6 * conditions[0]


@pytest.mark.parametrize(
    ("periodic", "matrix", "periods"),
    [
        (True, "the periodic A", "16 x 12"),
        ("x", "A continued periodically in y", "16 x "),
        ("y", "A continued periodically in x", " x 12"),
        (False, "A continued periodically in x and y", ""),
    ],
)
def test_view_names_the_sides_of_the_continuation(periodic, matrix, periods, tmp_path):
    grid = Grid.from_domain(16, 12, (-1, 1, -1, 1), periodic)
    mat = InfluenceOperator(grid, patch_kernel(UNIT, grid)).mat(PETSc.COMM_SELF)
    pc = PETSc.PC().createPython(Circulant(), PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setUp()
    viewer = PETSc.Viewer().createASCII(str(tmp_path / "view"), comm=PETSc.COMM_SELF)
    pc.view(viewer)
    for part in (viewer, pc, mat):
        part.destroy()
    text = (tmp_path / "view").read_text()
    assert f"  inverse of {matrix}, periods " in text
    assert periods in text


def test_extension_of_a_thin_stiff_layer_decays():
    """Without a limit of the neighbours' sum, each cycle of steps would amplify the residual."""
    kernel = Material.coated((10.0, 1.0), (0.3, 0.3), 1.0).kernel
    operator = InfluenceOperator(Grid(64, 64, 1.0, 1.0), kernel)
    operator.mask[...] = False
    operator.mask[28:36, 28:36] = True
    operator.mask_changed()
    mat, pc = operator.mat(PETSc.COMM_SELF), PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setType(PETSc.PC.Type.PYTHON)
    circulant = Circulant()
    pc.setPythonContext(circulant)
    with SolverOptions("", {"pc_circulant_extend": "8"}).inserted(), calling_petsc():
        pc.setFromOptions()
        pc.setUp()
    residual = operator.mask.astype(float)
    circulant.extend(residual)
    assert (residual[operator.mask] == 1).all()
    assert abs(residual).max() <= 1
    for part in (pc, mat):
        part.destroy()
