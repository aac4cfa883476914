"""The FFT preconditioner is symmetric and positive definite on every contact set."""

import numpy as np
import pytest
from operators import GRIDS, PERIODIC, STEEL
from petsc4py import PETSc

from app.fast.circulant import Circulant, circulant_inverse, circulant_of
from app.halfspace.grid import Grid
from app.halfspace.influence import dense_matrix
from app.halfspace.operator import InfluenceOperator
from app.petsc import OptionDatabase

SMALL = {name: grid for name, grid in (GRIDS | PERIODIC).items() if grid.n <= 500}


def preconditioner(operator, **options):
    """A PC, and its columns for all cells of C as a matrix (cells, cells of C)."""
    mat = operator.mat(PETSc.COMM_SELF)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(mat)
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(Circulant())
    with OptionDatabase({name: str(value) for name, value in options.items()}).active():
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


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("margin", [0.0, 0.3])
@pytest.mark.parametrize("grid", SMALL.values(), ids=SMALL.keys())
def test_symmetric_positive_definite_on_c(grid, margin, steps):
    operator = InfluenceOperator(grid, STEEL)
    rng = np.random.default_rng(grid.n + steps)
    for share in (0.05, 0.4, 1.1):
        operator.mask[...] = rng.random(grid.shape) < share
        operator.mask[0, 0] = True  # some cell
        operator.mask_changed()
        matrix = preconditioner(operator, pc_circulant_extend=steps, pc_circulant_margin=margin)
        inside = operator.mask.reshape(-1)
        assert (matrix[~inside] == 0).all()
        on_c = matrix[inside]
        np.testing.assert_allclose(on_c, on_c.T, rtol=0, atol=1e-12 * abs(on_c).max())
        assert np.linalg.eigvalsh((on_c + on_c.T) / 2)[0] > 0


def test_it_is_near_the_inverse():
    """What it is for: eigenvalues of B A lie together, whatever the grid."""
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


def test_the_circulant_inverts_itself():
    grid = GRIDS["even"]
    operator = InfluenceOperator(grid, STEEL)
    multiplier, x = circulant_of(operator), np.random.default_rng(1).normal(size=grid.shape)
    assert multiplier.periods == grid.shape  # where there is no margin
    y, back = np.empty(grid.shape), np.empty(grid.shape)
    multiplier.apply(x, y)
    multiplier.apply_inverse(y, back)
    np.testing.assert_allclose(back, x, rtol=0, atol=1e-12 * abs(x).max())
    assert circulant_of(operator) is multiplier  # made once
    assert circulant_of(operator, (0.5, 0.0)) is not multiplier


@pytest.mark.parametrize("kind", ["periodic", "window"])
def test_periodic_patches_and_windows_have_no_margin(kind):
    operator = InfluenceOperator(PERIODIC["periodic"] if kind == "periodic" else GRIDS["even"], STEEL)
    operator.narrower = (kind == "window",) * 2
    operator.mask[...] = True
    matrices = [preconditioner(operator, pc_circulant_margin=margin) for margin in (0.0, 0.3)]
    assert (matrices[0] == matrices[1]).all()


@pytest.mark.parametrize("n", [16, 32])
def test_a_margin_keeps_contact_at_opposite_edges_apart(n):
    """How many steps of CG it takes goes with the root of the condition number."""
    grid = Grid(n, n, 0.1, 0.1)
    operator = InfluenceOperator(grid, STEEL)
    operator.mask[...] = True
    conditions = []
    for margin in (0.0, 0.01, 0.3):
        product = preconditioner(operator, pc_circulant_margin=margin) @ dense_matrix(grid, STEEL)
        values = np.linalg.eigvals(product).real
        conditions.append(values.max() / values.min())
    assert conditions[1] < 0.6 * conditions[0]
    assert conditions[2] == pytest.approx(conditions[1], rel=0.1)  # more of it is of no use


@pytest.mark.parametrize("margin", [-0.1, 1.5])
def test_margins_that_cannot_be_are_refused(margin):
    operator = InfluenceOperator(GRIDS["even"], STEEL)
    operator.mask[...] = True
    with pytest.raises(ValueError, match="pc_circulant_margin"):
        preconditioner(operator, pc_circulant_margin=margin)


def test_eigenvalues_are_positive_on_stretched_cells():
    for dx, dy in ((1.0, 100.0), (1.0, 0.01)):
        grid = Grid(24, 20, dx, dy)
        inverse = circulant_inverse(grid, STEEL)
        assert inverse.all_positive()
