"""What a solver keeps between solves: nothing is made twice, and nothing else comes out."""

import gc
import re
import sys
import weakref
from types import SimpleNamespace

import numpy as np
import pytest
from cases import hertz, punch
from running import assert_proved_equal

from app import ContactProblem, ContactSolver, Grid, Listener, Material, SelfAffineSurface
from app.contact.distance import UndeformedDistance
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.operator import InfluenceOperator
from app.methods.free.circulant import circulant_inverse
from app.methods.free.solver import TrackingSolver
from app.methods.free.verification_product import VerificationProduct
from app.methods.multilevel_operators import multilevel_influence
from app.multigrid import solver_cache
from app.multigrid.linear_solver import LinearSolver

MAKES = re.compile(r"^(Vec|Mat|KSP|PC|IS)\.(create|duplicate|setFromOptions)|\.set_kernel$|\.set_spectrum$")


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


def test_a_second_solve_makes_nothing(made):
    with ContactSolver(bowl(160)) as solver:
        first = solver.solve(approach=0.3)
        assert made
        made.clear()
        second = solver.solve(approach=0.3)
        assert not made
        assert second.operator_applications == pytest.approx(first.operator_applications, abs=0.2)
        assert_proved_equal(second, first)


def test_windows_elsewhere_and_of_other_sizes(made):
    with ContactSolver(bowl(160)) as solver:
        for approach in (0.05, 0.3, 0.05):
            again = solver.solve(approach=approach)
            with ContactSolver(bowl(160)) as fresh:
                alone = fresh.solve(approach=approach)
            assert_proved_equal(again, alone)


def test_of_large_windows_spectra_are_kept_and_nothing_else(made, monkeypatch):
    monkeypatch.setattr(solver_cache, "MAX_CACHED_CELLS", 0)
    with ContactSolver(bowl(160)) as solver:
        solver.solve(approach=0.3)
        made.clear()
        solver.solve(approach=0.3)
        assert set(made) == {"__init__"}
        solver.solve(approach=0.1)
        assert "set_kernel" in made


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


def calls_of(function):
    """Names of all that is called from Python meanwhile; numba tells of compiled loops, too, from 0.57 on."""
    names = []

    def hear(frame, event, arg):
        if event == "c_call":
            names.append(arg.__qualname__)
        elif event == "call" and "__name__" in frame.f_globals:
            names.append(frame.f_code.co_qualname)

    sys.setprofile(hear)
    try:
        function()
    finally:
        sys.setprofile(None)
    return names


def test_a_second_solve_makes_no_objects_of_petsc_but_a_vector_or_two_on_each_grid():
    with ContactSolver(bowl(160)) as solver:
        solver.solve(approach=0.3)
        made = [name for name in calls_of(lambda: solver.solve(approach=0.301)) if MAKES.search(name)]
        assert set(made) <= {"Vec.createWithArray", "Vec.duplicate"}
        assert len(made) <= 2 * len(solver.hierarchy.levels)


def test_a_small_grid_does_not_wait_for_python():
    """It took 5,300 calls when every block of rows, and every strip of columns, was one; by load 4,700 long after."""
    with ContactSolver(hertz(64)) as solver:
        load = solver.solve(approach=0.1091).load
        assert len(calls_of(lambda: solver.solve(approach=0.1091))) < 2600
        solver.solve(load=load)  # imports
        assert len(calls_of(lambda: solver.solve(load=load))) < 3300


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


@pytest.mark.parametrize("more", [-1, 0, 1])
def test_only_a_large_target_gives_back_what_it_does_not_need(more):
    assert solver_cache.is_large(SimpleNamespace(n=solver_cache.MAX_CACHED_CELLS + more)) == (more > 0)


@pytest.mark.parametrize("holes_first", [False, True])
def test_another_gap_may_begin_on_another_grid(holes_first):
    """Holes where the coarsest grid has its cells' centres, and no other one."""
    grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    centres = -1 + (np.arange(8) + 0.5) / 4

    def holed(x, y):
        holes = (np.isclose(v[..., None], centres, atol=1e-9).any(axis=-1) for v in np.broadcast_arrays(x, y))
        return np.where(np.logical_and(*holes), np.nan, (x**2 + y**2) / 40)

    steel = Material.combined(80000, 0.3)
    problems = [ContactProblem(grid, steel, gap) for gap in (lambda x, y: (x**2 + y**2) / 40, holed)]
    first, second = problems[::-1] if holes_first else problems
    with ContactSolver(first) as solver, ContactSolver(second) as fresh:
        solver.solve(load=300)
        solver.update(second)
        again, alone = solver.solve(load=300), fresh.solve(load=300)
    np.testing.assert_array_equal(again.pressure, alone.pressure)


def test_no_load_is_the_same_after_another_one():
    """Which cells just touch is a matter of the last digits, which moving the bodies costs."""
    grid = Grid.from_domain(48, 48, (-1, 1, -1, 1))
    ball = ContactProblem(grid, Material.from_contact_modulus(1e5), lambda x, y: (x**2 + y**2) / 40)
    with ContactSolver(ball) as solver:
        first, _, again = (solver.solve(load=load) for load in (0, 100, 0))
    assert first.contact.any()
    np.testing.assert_array_equal(first.contact, again.contact)


class Stops(Listener):
    """Raises after some iterations, once."""

    def __init__(self, after):
        self.left = after

    def iteration(self, entry, state):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_what_was_interrupted_is_not_counted_with_the_next_solve(kind):
    value = {"approach": 0.01, "load": 0.05}[kind]
    with ContactSolver(bowl(256)) as fresh:
        alone = fresh.solve(**{kind: value})
    last = len(alone.history["level"])
    with ContactSolver(bowl(256), listeners=[Stops(last)]) as solver:
        with pytest.raises(KeyboardInterrupt):
            solver.solve(**{kind: value})
        again = solver.solve(**{kind: value})
    assert again.operator_applications == pytest.approx(alone.operator_applications, rel=1e-12)


def test_a_periodic_patch_has_its_solvers_before_the_first_solve(monkeypatch):
    made, plain = [], LinearSolver.__init__
    monkeypatch.setattr(
        LinearSolver, "__init__", lambda self, *a, **named: (made.append(self), plain(self, *a, **named))[1]
    )
    grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.combined(1.0, 0.0), bowl(64).gap, periodic=True)
    with ContactSolver(problem) as solver:
        assert len(made) == len(solver.hierarchy.levels)
        made.clear()
        first, second = (solver.solve(load=0.01) for _ in range(2))
        assert not made
        np.testing.assert_array_equal(first.pressure, second.pressure)


@pytest.mark.parametrize("kind", ["approach", "load"])
def test_distances_of_windows_are_freed_with_them(monkeypatch, kind):
    """PETSc keeps what Python drops until a solver is closed; a loop over loads closes none."""
    parts, part_of = [], UndeformedDistance.part_of
    monkeypatch.setattr(UndeformedDistance, "part_of", lambda *of: parts.append(part_of(*of)) or parts[-1])
    with ContactSolver(bowl(256)) as solver:
        solver.solve(**{kind: {"approach": 0.01, "load": 0.05}[kind]})
    assert len(parts) > 1  # of a coarse grid, too
    assert all(not part.rhs for part in parts)
