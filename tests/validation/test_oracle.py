"""Small contact problems of all kinds against solvers that share nothing with ours.

Either every contact set is tried, or PETSc solves the dense problem: Newton with a reduced space (SNESVI), or
projected Newton with a trust region (TAO's tron) for ``min p.Ap/2 + h.p, p >= 0``.
"""

from itertools import product

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from petsc4py import PETSc
from running import solve

from app import ContactProblem
from app.halfspace.grid import Grid
from app.halfspace.influence import Material, dense_matrix

UNIT = Material(1 / np.pi, 0.0)  # compliance 1
fifty = settings(max_examples=50, derandomize=True, deadline=None, database=None)


@st.composite
def problems(draw, largest):
    """A random problem, its dense matrix and its h; ties, zeros and holes are likely."""
    ny = draw(st.integers(1, largest))
    nx = draw(st.integers(1, largest))
    aspect = draw(st.sampled_from([1.0, 0.7, 4.0, 30.0]))
    scale = draw(st.sampled_from([1.0, 1e-6, 1e5]))
    heights = st.one_of(st.integers(-3, 3).map(float), st.floats(-3, 3, width=32, allow_subnormal=False))
    shape = scale * draw(arrays(float, (ny, nx), elements=heights))
    holes = draw(arrays(bool, (ny, nx), elements=st.sampled_from([False] * 4 + [True])))
    shape[holes & (holes.sum() < holes.size)] = np.nan
    approach = scale * draw(st.sampled_from([0.0, 0.5, 1.0, 4.0]))
    grid = Grid(nx, ny, 1.0, aspect)
    return ContactProblem(grid, UNIT, shape), approach


def admissible_part(problem, approach):
    h = (problem.gap - approach).reshape(-1)
    inside = ~np.isnan(h)
    return dense_matrix(problem.grid, UNIT.compliance)[np.ix_(inside, inside)], h[inside], inside


def by_trying_all(A, h):
    """The contact set whose solution satisfies all conditions best, hence its pressure."""
    best, least = None, np.inf
    for members in product((False, True), repeat=len(h)):
        contact = np.array(members)
        p = np.zeros(len(h))
        p[contact] = np.linalg.solve(A[np.ix_(contact, contact)], -h[contact])
        violation = max((-p).max(), -(h + A @ p).min() / A.max())
        if violation < least:
            best, least = p, violation
    return best


def vector(values):
    return PETSc.Vec().createWithArray(np.array(values, float), comm=PETSc.COMM_SELF)


def by_snesvi(A, h):
    matrix = PETSc.Mat().createDense(A.shape, array=A, comm=PETSc.COMM_SELF)
    shift, p, work = vector(h), vector(np.zeros(len(h))), vector(np.zeros(len(h)))
    lower, upper = vector(np.zeros(len(h))), vector(np.full(len(h), PETSc.INFINITY))

    def residual(snes, x, f):
        matrix.multAdd(x, shift, f)

    snes = PETSc.SNES().create(PETSc.COMM_SELF)
    snes.setType("vinewtonrsls")
    snes.setFunction(residual, work)
    snes.setJacobian(lambda snes, x, J, P: None, matrix)
    snes.setVariableBounds(lower, upper)
    snes.setTolerances(atol=1e-13, rtol=0, stol=0, max_it=200)
    snes.getKSP().setType("preonly")
    snes.getKSP().getPC().setType("lu")
    snes.solve(None, p)
    assert snes.getConvergedReason() > 0 or not np.any(h < 0)
    found = np.array(p.getArray())
    for thing in (snes, matrix, shift, p, work, lower, upper):
        thing.destroy()
    return found


def by_tron(A, h):
    matrix = PETSc.Mat().createDense(A.shape, array=A, comm=PETSc.COMM_SELF)
    shift, p = vector(h), vector(np.zeros(len(h)))
    lower, upper = vector(np.zeros(len(h))), vector(np.full(len(h), PETSc.INFINITY))

    def energy(tao, x, gradient):
        matrix.mult(x, gradient)
        value = 0.5 * x.dot(gradient) + x.dot(shift)
        gradient.axpy(1, shift)
        return value

    tao = PETSc.TAO().create(PETSc.COMM_SELF)
    tao.setType("tron")
    work = p.duplicate()
    tao.setObjectiveGradient(energy, work)
    tao.setHessian(lambda tao, x, H, P: None, matrix)
    tao.setVariableBounds((lower, upper))
    tao.setTolerances(gatol=1e-13, grtol=0, gttol=0)
    tao.setMaximumIterations(500)
    tao.getKSP().setType("cg")
    tao.getKSP().setTolerances(rtol=1e-14)
    tao.getKSP().getPC().setType("jacobi")
    tao.solve(p)
    found = np.array(p.getArray())
    for thing in (tao, matrix, shift, p, work, lower, upper):
        thing.destroy()
    return found


def assert_found(problem, approach, oracle, tolerance, **how):
    A, h, inside = admissible_part(problem, approach)
    size = np.abs(h).max() or 1.0  # PETSc's solvers have absolute tolerances
    expected = size * oracle(A, h / size)
    solution = solve(problem, approach, **how)
    assert solution.converged, solution.message
    found = solution.pressure.reshape(-1)
    assert (found[~inside] == 0).all()
    np.testing.assert_allclose(found[inside], expected, rtol=0, atol=tolerance * size / A.max())


@fifty
@given(problems(largest=3).filter(lambda case: (~np.isnan(case[0].gap)).sum() <= 9))
def test_all_contact_sets_tried(case):
    assert_found(*case, by_trying_all, 1e-9, lcp_rtol=1e-12)


@pytest.mark.parametrize("oracle", [by_snesvi, by_tron])
@fifty
@given(case=problems(largest=7))
def test_petsc_on_the_dense_matrix(oracle, case):
    assert_found(*case, oracle, 1e-7, lcp_rtol=1e-12)


@fifty
@given(problems(largest=9))
def test_default_method(case):
    assert_found(*case, by_tron, 1e-5, method="fast", lcp_rtol=1e-9)
