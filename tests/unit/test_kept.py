"""What a solver keeps between solves: nothing is made twice, and nothing else comes out."""

import gc
import weakref

import numpy as np
import pytest
from cases import punch
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface
from app.contact.distance import UndeformedDistance
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.operator import InfluenceOperator
from app.methods.free.circulant import circulant_inverse
from app.methods.free.solver import TrackingSolver
from app.methods.free.verification_product import VerificationProduct
from app.methods.multilevel_operators import multilevel_influence


def bowl(n, height=1.0):
    grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
    x, y = np.meshgrid(grid.x(), grid.y())
    return ContactProblem(grid, Material.combined(1.0, 0.0), height * (x**2 + y**2))


@pytest.fixture
def made(monkeypatch):
    """List of what has been made: spectra and linear solvers."""
    things = []

    def counting(of, name):
        plain = getattr(of, name)
        monkeypatch.setattr(
            of, name, lambda self, *given, **named: (things.append(name), plain(self, *given, **named))[1]
        )

    counting(EvenMultiplier, "set_kernel")
    counting(TrackingSolver, "__init__")
    return things


def test_windows_elsewhere_and_of_other_sizes(made):
    with ContactSolver(bowl(160)) as solver:
        for approach in (0.05, 0.3, 0.05):
            again = solver.solve(approach=approach)
            with ContactSolver(bowl(160)) as fresh:
                alone = fresh.solve(approach=approach)
            assert_proved_equal(again, alone)


def test_light_loads_look_through_windows_of_one_size(made):
    with ContactSolver(bowl(256)) as solver:
        solver.solve(approach=1e-3)
        made.clear()
        for approach in (2e-3, 4e-3, 8e-3):
            solver.solve(approach=approach)
        assert not made


def test_hardly_any_verification_fails(monkeypatch):
    """Every second one did when none was rehearsed."""
    products, plain = [], VerificationProduct.apply_on_all
    monkeypatch.setattr(
        VerificationProduct, "apply_on_all", lambda self, *a: (products.append(0), plain(self, *a))
    )
    with ContactSolver(punch(160)) as solver:
        loads = np.geomspace(100, 4e4, 10)
        for load in loads:
            assert solver.solve(load=load).converged
    assert len(loads) <= len(products) <= 1.3 * len(loads)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nor_where_the_last_release_moves_the_approach(monkeypatch, seed):
    """Nearly full contact by load: five of six made a product too many while a release was not rehearsed."""
    n, products, plain = 192, [], InfluenceOperator.exact_displacement

    def counted(operator, *fields):
        if operator.grid.n == n * n:
            products.append(0)
        plain(operator, *fields)

    monkeypatch.setattr(InfluenceOperator, "exact_displacement", counted)
    grid = Grid.from_domain(n, n, (0.0, 1.0, 0.0, 1.0))
    surface = SelfAffineSurface(0.8, 1 / 8, 8 / n, (1.0, 1.0), seed, rms_slope=0.1)
    height = surface.height(grid.x(), grid.y())
    loads = 9e3, 1.2e4, 1.5e4, 1.8e4, 2.1e4, 2.4e4
    with ContactSolver(
        ContactProblem(grid, Material.from_contact_modulus(1e5), height.max() - height)
    ) as solver:
        for load in loads:
            assert solver.solve(load=load).converged
    assert len(loads) <= len(products) <= len(loads) + 1


def test_fields_of_all_cells_are_not_kept():
    with ContactSolver(bowl(160)) as solver:
        field = weakref.ref(solver.solve(approach=0.1).displacement)
        gc.collect()
        assert field() is None


def test_what_an_exact_product_has_computed_stays_counted():
    operator = InfluenceOperator(Grid(40, 40, 1.0, 1.0), 1.0, dtype=np.float32)
    p = np.ones(operator.local_shape)
    operator.exact_displacement(p, p.copy())
    operator.displacement(p, p.copy())
    operator.free_exact_product()
    assert operator.equivalent_products == 2


def test_nobody_works_in_what_is_lent():
    """Neither the preconditioner nor what lifts pressures."""
    operator = InfluenceOperator(Grid(640, 640, 1.0, 1.0), 1.0, dtype=np.float32)
    operator.prepare("exact_product", "product")
    lent = [field for field in operator.spare_fields(np.float64, np.float32) if field is not None]
    assert lent
    for field in lent:
        field[...] = 7.0
    p = np.ones(operator.local_shape, np.float32)
    for multiplier in (
        circulant_inverse(operator),
        circulant_inverse(operator, apart=True),
        multilevel_influence(operator),
    ):
        multiplier.apply(p, p)
    assert all((field == 7.0).all() for field in lent)


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_distances_of_windows_are_freed_with_them(monkeypatch, kind):
    """PETSc keeps what Python drops until a solver is closed; a loop over loads closes none."""
    parts, part_of = [], UndeformedDistance.part_of
    monkeypatch.setattr(UndeformedDistance, "part_of", lambda *of: parts.append(part_of(*of)) or parts[-1])
    with ContactSolver(bowl(256)) as solver:
        solver.solve(**{kind: {"approach": 0.01, "load": 0.05}[kind]})
    assert len(parts) > 1  # of a coarse grid, too
    assert all(not part.rhs for part in parts)
