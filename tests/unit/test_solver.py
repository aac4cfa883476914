"""The Python API: solvers beside each other, again and again, from where another ended; what is refused."""

import ctypes
import gc
import pickle
import tracemalloc
import warnings
import weakref
from dataclasses import replace

import numpy as np
import pytest
import running
from cases import APPROACH, hertz, punch
from mpi4py import MPI
from petsc4py import PETSc
from running import assert_proved_equal, assert_solves_lcp

from app import ContactProblem, ContactSolver, Grid, Listener, Material, Solution, Sphere, read_result, solve
from app.api.solution import RUN_ATTRIBUTES
from app.base.errors import InputError
from app.contact import measures
from app.contact.distance import UndeformedDistance
from app.halfspace.fft.multiplier import EvenMultiplier
from app.options.method import METHOD_OPTIONS, read_method_file

METHODS = {
    "fast": (None, {}),
    "norm": ("norm", {}),
    "mg": ("mg_v11", {}),
    "fmg": ("fmg_v11", {}),
    "tao": (None, {"lcp_type": "tao"}),
    "snesvi": (None, {"lcp_type": "snesvi"}),
    "primal": (None, {}),
}
each_method = pytest.mark.parametrize("method", METHODS)


def problem_of(method, problem=None):
    """That problem, or a punch; of the primal form on a periodic patch."""
    problem = problem or punch(24)
    return problem.on(replace(problem.grid, periodic="spectral")) if method == "primal" else problem


def solver_of(method, problem=None, **options):
    name, own = METHODS[method]
    return ContactSolver(problem_of(method, problem), name, own | options)


def assert_same(found, expected, rounding=0.0):
    """To the last bit, or but for what an approach on the way has rounded of the distances."""
    assert (found.load, found.approach) == pytest.approx(
        (expected.load, expected.approach), rel=rounding, abs=0
    )
    assert found.iterations == expected.iterations
    for name in ("pressure", "displacement", "undeformed_distance", "contact"):
        field = getattr(expected, name)
        atol = rounding * np.nanmax(field)
        np.testing.assert_allclose(getattr(found, name), field, rtol=0, atol=atol)


def copy_of(solution):
    return {name: getattr(solution, name).copy() for name in ("pressure", "displacement", "contact", "gap")}


# ---------------------------------------------------------------------------------- one after another


@pytest.fixture
def products_left(monkeypatch):
    """A list of a number: so many products from now on is an interrupt; 0: never."""
    apply, left = EvenMultiplier.apply, [0]

    def interrupted(*arguments, **named):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        return apply(*arguments, **named)

    monkeypatch.setattr(EvenMultiplier, "apply", interrupted)
    return left


@each_method
@pytest.mark.parametrize("number", [2, 9, 17])
def test_a_solver_goes_on_after_an_interrupt(method, number, products_left):
    """In the midst of PETSc's solvers, which keep what they are left with; they crashed then."""
    with solver_of(method) as solver:
        expected = solver.solve(approach=0.1).pressure
        products_left[0] = number
        with pytest.raises(KeyboardInterrupt):
            solver.solve(approach=0.1)
        found = solver.solve(approach=0.1).pressure
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * expected.max())


@each_method
def test_an_interrupt_is_not_lost_if_garbage_is_due(method, monkeypatch):
    """Python 3.12 may collect it while the exception is on its way through PETSc."""

    class Node:
        pass

    thresholds, kept = gc.get_threshold(), []

    def interrupted(*_, **__):
        node = Node()
        node.itself = node
        kept.append(weakref.ref(node, kept.remove))
        del node
        gc.set_threshold(1)  # the exception is one object too many
        raise KeyboardInterrupt

    with solver_of(method) as solver:
        monkeypatch.setattr(EvenMultiplier, "apply", interrupted)
        try:
            with pytest.raises(KeyboardInterrupt):
                solver.solve(approach=0.1)
        finally:
            gc.set_threshold(*thresholds)


@pytest.mark.parametrize("method", ["fast", "primal", "fmg"])
def test_interrupted_solves_leave_no_fields(method, products_left):
    """PETSc keeps what Python forgets until somebody asks: the next solve does."""
    with solver_of(method, punch(128)) as solver:
        solver.solve(approach=0.1)
        tracemalloc.start()
        try:
            held = []
            for _ in range(3):
                for _ in range(5):
                    products_left[0] = 4
                    with pytest.raises(KeyboardInterrupt):
                        solver.solve(approach=0.1)
                    products_left[0] = 0
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
    assert max(np.diff(held)) < 8 * 128**2  # a field; it was one for every interrupt


@pytest.mark.parametrize("loading", [{"approach": -1.0}, {"load": 0.0}, {"approach": 0.1}])
def test_a_start_has_to_fit_without_pressure_too(loading):
    other = solve(punch(20), approach=0.1)
    with solver_of("fast") as solver:
        for start in "nonsense", other:
            with pytest.raises(InputError, match="start: must be a Solution on the same grid"):
                solver.solve(**loading, start=start)


def test_who_has_begun_to_listen_hears_of_the_end():
    heard = []

    class Named(Listener):
        def __init__(self, name):
            self.name = name

        def begin(self, settings):
            heard.append(f"{self.name} begins")
            if self.name == "b":
                raise OSError

        def end(self):
            heard.append(f"{self.name} ends")

    with (
        ContactSolver(punch(24), listeners=[Named(name) for name in "abc"]) as solver,
        pytest.raises(OSError),
    ):
        solver.solve(approach=0.1)
    assert heard == ["a begins", "b begins", "a ends"]


def test_a_flat_body_is_measured_once():
    calls = []

    def flat(x, y):
        calls.append(None)
        return np.where(np.hypot(x, y) < 1, 0.0, np.nan) + 0 * x * y

    with ContactSolver(
        ContactProblem(Grid.from_domain(32, 32, (-2, 2, -2, 2)), Material.combined(8e4, 0.3), flat)
    ) as solver:
        made = len(calls)
        loads = [solver.solve(load=load).load for load in (1.0, 2.0, 1e3)]
    assert loads == pytest.approx([1.0, 2.0, 1e3]) and len(calls) == made


@each_method
def test_solving_twice_is_solving_in_two_solvers(method):
    """What was solved before leaves no trace."""
    with solver_of(method) as once, solver_of(method) as again:
        expected = once.solve(approach=0.1)
        again.solve(approach=-0.15)
        assert_same(again.solve(approach=0.1), expected, rounding=1e-9)
        assert_same(once.solve(approach=0.1), expected)


@each_method
def test_solutions_stay_what_they_are(method):
    with solver_of(method) as solver:
        first = solver.solve(approach=0.1)
        before = copy_of(first)
        solver.solve(approach=0.2)
        solver.solve(approach=-0.15, start=None if method in ("tao", "snesvi") else first)
    gap = before.pop("gap")  # from h, which is moved back: but for rounding
    np.testing.assert_allclose(first.gap, gap, rtol=0, atol=1e-15 * np.nanmax(abs(first.undeformed_distance)))
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(first, name), values)
    assert_solves_lcp(first)


def test_solvers_of_different_methods_are_alive_at_once():
    expected = {
        method: solve(problem_of(method), approach=0.1, method=name, options=own)
        for method, (name, own) in METHODS.items()
    }
    solvers = {method: solver_of(method) for method in METHODS}
    for approach in (-0.1, 0.1):
        found = {method: solver.solve(approach=approach) for method, solver in solvers.items()}
    for method in METHODS:
        assert_same(found[method], expected[method], rounding=1e-9)
    for method in ("fmg", "tao", "fast", "primal", "norm", "snesvi", "mg"):  # not in the order they were made
        solvers.pop(method).close()
        for other in solvers.values():
            assert other.solve(approach=0.1).converged


def test_options_of_one_solver_are_not_those_of_another():
    with solver_of("norm") as loose, solver_of("norm", lcp_rtol=1e-12) as tight:
        assert loose.settings.rtol == 1e-6
        coarse, fine = (solver.solve(approach=0.1) for solver in (loose, tight))
    assert fine.residual <= 1e-12 < coarse.residual
    assert "-lcp_rtol 1e-12" in fine.options
    assert "-lcp_rtol" not in coarse.options


# --------------------------------------------------------------------------------------------- starts


@pytest.mark.parametrize("method", ["fast", "norm", "mg", "fmg"])
@pytest.mark.parametrize("by_load", [False, True], ids=["approach", "load"])
def test_a_start_saves_work_and_does_not_change_the_answer(method, by_load):
    with solver_of(method, hertz(64), lcp_rtol=1e-9) as solver:
        first = solver.solve(approach=APPROACH)
        cold = solver.solve(approach=1.01 * APPROACH)
        loading = {"load": cold.load} if by_load else {"approach": cold.approach}
        warm = solver.solve(**loading, start=first)
        same = solver.solve(**loading, start=cold)
    assert_solves_lcp(warm, 1e-9)
    highest = cold.pressure.max()
    np.testing.assert_allclose(warm.pressure, cold.pressure, rtol=0, atol=1e-6 * highest)
    np.testing.assert_array_equal(warm.contact, cold.contact)
    assert warm.operator_applications < 1.5 * cold.operator_applications
    assert same.operator_applications < 0.6 * cold.operator_applications


def test_any_solution_on_the_grid_is_a_start():
    problem = hertz(32)
    expected = solve(problem, approach=APPROACH, options={"lcp_rtol": 1e-9})
    with ContactSolver(problem, options={"lcp_rtol": 1e-9}) as solver:
        starts = [
            solver.solve(approach=-1.0),
            solver.solve(load=0),
            solver.solve(approach=1.0),
            solve(problem, approach=0.05, method="norm"),
            solve(punch_on(problem.grid), approach=0.1),
        ]
        for start in starts:
            for loading in ({"approach": APPROACH}, {"load": expected.load}):
                found = solver.solve(**loading, start=start)
                assert_solves_lcp(found, 1e-9)
                assert found.load == pytest.approx(expected.load, rel=1e-7)
                np.testing.assert_array_equal(found.contact, expected.contact)


def punch_on(grid):
    return ContactProblem(grid, hertz(8).material, lambda x, y: np.where(x**2 + y**2 < 9, 0 * x * y, np.nan))


# --------------------------------------------------------------------------------------- what is left


@each_method
def test_the_global_options_are_none_of_its_business(method):
    database = PETSc.Options()
    database.setValue("ksp_rtol", "0.5")
    database.setValue("lcp_rtol", "nonsense")
    try:
        before = database.getAll()
        with solver_of(method) as solver:
            found = solver.solve(approach=0.1)
            assert database.getAll() == before
        assert database.getAll() == before
    finally:
        for name in ("ksp_rtol", "lcp_rtol"):
            database.delValue(name)
    with solver_of(method) as solver:
        assert_same(solver.solve(approach=0.1), found)


def test_options_with_a_prefix_come_from_the_global_ones():
    database = PETSc.Options()
    database.setValue("mine_lcp_rtol", "1e-9")
    try:
        with ContactSolver(punch(24), options={"lcp_rtol": 1e-3, "lcp_max_it": 50}, prefix="mine_") as solver:
            assert (solver.settings.rtol, solver.settings.max_it) == (1e-9, 50)
            assert solver.solve(approach=0.1).residual <= 1e-9
        assert database.getAll() == {"mine_lcp_rtol": "1e-9"}
    finally:
        database.delValue("mine_lcp_rtol")


def communicators():
    """Highest number of the next communicators; each gets the lowest that is free, some below what is kept."""
    comms = [MPI.COMM_SELF.Dup() for _ in range(20)]
    number = max(comm.py2f() for comm in comms)
    for comm in comms:
        comm.Free()
    return number


class Mallinfo(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    )


def allocated():
    """What C has allocated and not freed [bytes]; the system counts what is kept for the next time, too."""
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = Mallinfo
    told = mallinfo()
    return told.uordblks + told.hblkhd


@pytest.mark.parametrize(
    ("method", "closed"),
    [*((method, True) for method in METHODS), ("fast", False)],
    ids=[*METHODS, "forgotten"],
)
def test_memory_and_communicators_come_back(method, closed):
    grid = hertz(40)
    vector = 8 * 40**2  # bytes

    def use(times):
        for _ in range(times):
            solver = solver_of(method, grid, lcp_rtol=1e-2)
            solver.solve(approach=APPROACH / 2)
            if closed:
                solver.close()
        solver = None
        gc.collect()
        return allocated(), communicators()

    memory, numbers = zip(*(use(times) for times in (5, 10, 10)), strict=True)
    assert len(set(numbers)) == 1
    assert min(np.diff(memory)) < 9 * vector
    tracemalloc.start()
    try:
        use(1)
        held = [tracemalloc.get_traced_memory()[0]]
        for _ in range(2):
            use(6)
            held.append(tracemalloc.get_traced_memory()[0])
        assert min(np.diff(held)) < 5 * vector  # Python's own tables, as of finalizers, may double once
    finally:
        tracemalloc.stop()


# --------------------------------------------------------------------------------------- what is said


def test_solution_is_whole_and_frozen(tmp_path):
    with ContactSolver(punch(24)) as solver:
        found = solver.solve(load=3e4)
        assert isinstance(found, Solution)
        assert solver.setup_seconds == found.setup_seconds > 0
    assert found.pressure.shape == found.gap.shape == (24, 24)
    assert found.contact.dtype == bool
    assert found.load == pytest.approx(found.pressure.sum() * found.grid.cell_area, rel=1e-12)
    assert found.contact_cells == found.contact.sum()
    assert found.contact_fraction == found.contact_cells / np.count_nonzero(~np.isnan(found.gap))
    assert found.max_pressure == found.pressure.max()
    assert found.error_bound == found.certificate.error_bound < 0.01
    np.testing.assert_array_equal(found.gap, found.undeformed_distance + found.displacement)
    np.testing.assert_array_equal(found.x, found.grid.x())
    np.testing.assert_array_equal(found.y, found.grid.y())
    with pytest.raises(AttributeError):
        found.load = 1.0
    found.save(tmp_path / "found.h5", mine=7)
    saved = read_result(tmp_path / "found.h5")
    np.testing.assert_array_equal(saved.pressure, found.pressure)
    assert saved.attributes["load"] == found.load


def test_a_file_has_fields_of_ones_own_beside_its_own_ones(tmp_path):
    with ContactSolver(hertz(16)) as solver:
        found = solver.solve(approach=APPROACH)
    wear = np.arange(256.0).reshape(16, 16)
    found.save(tmp_path / "found.h5", wear=wear, passes=3)
    saved = read_result(tmp_path / "found.h5")
    np.testing.assert_array_equal(saved.extra["wear"], wear)
    assert saved.attributes["passes"] == 3
    for name in (*found.attributes, "pressure", "x", "history", "units", "message"):
        if name in RUN_ATTRIBUTES:
            continue
        for value in (wear, 3):
            with pytest.raises(InputError, match=f"{name} is there already; take another name"):
                found.save(tmp_path / "other.h5", **{name: value})
    columns = {"load": [1.0, 2.0], "approach": [1.0]}
    for steps, message in (
        (3, "steps: int; needed: columns by name"),
        ({"load": 1.0}, r"steps: column load: shape \(\), type float64; needed: a number for each step"),
        ({"load": ["a"]}, "column load: .*; needed: a number for each step"),
        (columns, r"column load: shape \(2,\), .*; needed: a number for each step"),
    ):
        with pytest.raises(InputError, match=message):
            found.save(tmp_path / "other.h5", steps)
    assert not (tmp_path / "other.h5").exists()


@pytest.mark.parametrize("shape", [(24, 1), (1, 24), (24, 16)])
def test_a_result_has_the_grid_of_its_solution(tmp_path, shape):
    """Also where a single cell centre does not tell the size of its cell: plane strain."""
    grid = Grid(*shape, 0.01, 0.02, 3.0, 4.0, "spectral")
    waves = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: 1e-4 * np.cos(20 * x + 10 * y))
    found = solve(waves, mean_pressure=1.0)
    found.save(tmp_path / "found.h5")
    read = read_result(tmp_path / "found.h5").grid
    assert (read.shape, read.periodic) == (grid.shape, grid.periodic)
    np.testing.assert_allclose([read.dx, read.dy, read.x0, read.y0], [0.01, 0.02, 3.0, 4.0], rtol=1e-12)
    assert read_result(tmp_path / "found.h5").contact_patches().sum() == pytest.approx(found.contact_area)


def test_solutions_and_paths_can_be_pickled():
    with ContactSolver(hertz(16)) as solver:
        path = solver.path(load=[100, 200])
        *_, solution = path
        later = solver.solve(load=50)  # moves the bodies that the solution has come from
    copy, table = pickle.loads(pickle.dumps(solution)), pickle.loads(pickle.dumps(path)).table
    assert repr(copy.attributes) == repr(solution.attributes)  # some are NaN
    for name in ("pressure", "gap", "undeformed_distance", "contact", "x", "y"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(solution, name))
    assert copy.contact_patches().tolist() == solution.contact_patches().tolist()
    assert table["load"].tolist() == path.table["load"].tolist()
    assert later.approach < copy.approach


def test_not_converged_is_a_warning_and_an_answer():
    with pytest.warns(RuntimeWarning, match="not converged: .*not enough") as said:
        found = solve(punch(24), approach=0.1, method="norm", options={"lcp_max_it": 1})
    assert [warning.filename for warning in said] == [__file__]
    assert not found.converged
    assert found.iterations == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert solve(punch(24), approach=0.1).converged


def test_who_misses_the_load_is_not_proved():
    """What he has is a solution for his own approach at best."""
    with pytest.warns(RuntimeWarning, match="not converged"):
        found = solve(punch(24), load=1e4, method="norm", options={"lcp_max_it": 3})
    assert abs(found.load - 1e4) > 10 and found.error_bound == np.inf
    assert solve(punch(24), load=1e4, method="norm").error_bound < 1e-3


@pytest.mark.parametrize("where", ["on_levels", "measure_roughness"])
def test_an_update_that_fails_leaves_the_old_problem(monkeypatch, where):
    """However late: here there is no more memory for the new one."""

    def no_memory(*_):
        raise MemoryError

    other = ContactProblem(punch(24).grid, punch(24).material, lambda x, y: x**2 + y**2)
    with ContactSolver(punch(24)) as solver:
        before = solver.solve(load=1e4)
        with monkeypatch.context() as patch:
            patch.setattr(
                {"on_levels": UndeformedDistance, "measure_roughness": measures}[where], where, no_memory
            )
            with pytest.raises(MemoryError):
                solver.update(other)
        after = solver.solve(load=1e4)
    assert_proved_equal(after, before)


# ------------------------------------------------------------------------------------ what is refused


def test_a_number_without_a_name_is_neither_approach_nor_load():
    with pytest.raises(TypeError, match="positional"):
        solve(punch(24), 100)
    with ContactSolver(punch(24)) as solver, pytest.raises(TypeError, match="positional"):
        solver.solve(100)


LOADINGS = {
    "both": ({"approach": 0.1, "load": 1.0}, "exactly one"),
    "neither": ({}, "exactly one"),
    "nan": ({"approach": np.nan}, "approach nan: allowed: a number"),
    "infinite": ({"load": np.inf}, "load inf: allowed: a number"),
    "huge": ({"approach": 1e60}, "approach 1e.60: allowed: a number"),
    "text": ({"approach": "deep"}, "approach: is str; needed: a number"),
    "pull": ({"load": -1.0}, "load -1"),
    "array": ({"load": [1.0, 2.0]}, "allowed: a number"),
    "start": ({"approach": 0.1, "start": "here"}, "start"),
}


@pytest.mark.parametrize("case", LOADINGS)
def test_loading_that_cannot_be(case):
    loading, message = LOADINGS[case]
    with ContactSolver(punch(24)) as solver:
        with pytest.raises(InputError, match=message):
            solver.solve(**loading)
        assert solver.solve(approach=0.1).converged  # it is none the worse for it


def test_start_on_another_grid():
    other = solve(punch(20), approach=0.1)
    with ContactSolver(punch(24)) as solver, pytest.raises(InputError, match="same grid"):
        solver.solve(approach=0.1, start=other)


def test_loads_are_not_for_the_reference_solvers():
    with solver_of("tao") as solver, pytest.raises(InputError, match="by approach only"):
        solver.solve(load=1.0)


@pytest.mark.parametrize(
    "ask",
    {
        "solve": lambda solver: solver.solve(approach=0.1),
        "check": lambda solver: solver.check(approach=0.1),
        "path": lambda solver: solver.path(approach=[0.1]),
        "stiffness": lambda solver: solver.stiffness(None),
    }.values(),
)
def test_a_closed_solver_solves_nothing(ask):
    solver = ContactSolver(punch(24))
    solver.close()
    solver.close()
    with pytest.raises(InputError, match="closed"):
        ask(solver)


OPTIONS = {
    "unknown method": ({"method": "faster"}, "method 'faster': must be one of .*fmg_v11"),
    "a problem is no method": ({"method": "hertz"}, "problem|hertz"),
    "unknown option": ({"options": {"lcp_foo": 1}}, "lcp_foo"),
    "misspelt option of PETSc": ({"options": {"ksp_rtoll": 1}}, "ksp_rtoll"),
    "value that is no number": ({"options": {"lcp_rtol": "small"}}, "-lcp_rtol small"),
    "tolerance beyond all": ({"options": {"lcp_rtol": 1.0}}, "-lcp_rtol 1"),
    "unknown KSP": ({"options": {"ksp_type": "gc"}}, "gc"),
    "unknown PC": ({"options": {"pc_type": "gc"}}, "gc"),
    "unknown smoother": ({"method": "fmg_v11", "options": {"mg_levels_pc_type": "gc"}}, "gc"),
    "unknown KSP of SNESVI": ({"options": {"lcp_type": "snesvi", "ksp_type": "gc"}}, "gc"),
    "unknown line search": ({"options": {"lcp_type": "tao", "tao_ls_type": "gc"}}, "gc"),
    "linear solver that needs entries": ({"method": "norm", "options": {"pc_type": "gamg"}}, "No method"),
    "only the default method": ({"method": "norm", "options": {"lcp_predictor": 1.0}}, "lcp_predictor.*no effect"),
    "only nested": ({"method": "mg_v11", "options": {"lcp_beta": 0.01}}, "lcp_beta.*no effect"),
    "only by copy": ({"options": {"lcp_beta": 0.01}}, "lcp_beta.*no effect"),
    "only active sets": ({"options": {"lcp_type": "tao", "lcp_nested": True}}, "lcp_nested.*no effect"),
    "levels of no multigrid": ({"method": "norm", "options": {"mg_levels_pc_type": "sor"}}, "mg_levels_pc_type"),
    "smoother without effect": (
        {"method": "fmg_v11", "options": {"mg_levels_pc_type": "jacobi", "mg_levels_pc_sor_omega": 0.3}}, "omega"
    ),
    "smoother without bounds": (
        {"method": "fmg_v11", "options": {"mg_levels_ksp_type": "chebyshev"}}, "mg_levels_ksp_chebyshev_eigenvalues"
    ),
    "mistake in a file that is overridden": (
        {"method": {"m": {"pc_type": "mg", "pc_mg_tipe": "full"}}, "options": {"pc_type": "none"}}, "tipe$"
    ),
    "idle in its own file": ({"method": {"m": {"ksp_type": "cg", "lcp_beta": "1"}}}, "lcp_beta 1: has no effect"),
    "no tracking": ({"method": "fast", "options": {"ksp_type": "cg"}}, "TrackingCG|ksp_python_type"),
}  # fmt: skip


OVERRIDDEN = {  # method, and options that leave much of it without a reader
    "multigrid": ("fmg_v11", {"pc_type": "none", "ksp_type": "cg", "ksp_max_it": 30}),
    "preconditioner": ("fast", {"pc_type": "none"}),
    "nested": ("fast", {"lcp_nested": False}),
    "smoother": (
        "fmg_v11",
        {
            "mg_levels_ksp_type": "chebyshev",
            "mg_levels_pc_type": "jacobi",
            "mg_levels_ksp_max_it": 2,
            "mg_levels_ksp_chebyshev_eigenvalues": "0.5,30",
        },
    ),
    "strategy": ("fast", {"lcp_type": "tao"}),
    "strategy, by a file": ({"a": read_method_file("fmg_v11"), "b": read_method_file("norm")}, {}),
    "method, by a file": (
        {"a": read_method_file("fast"), "b": read_method_file("fmg_v11")},
        {"lcp_rtol": 1e-7},
    ),
}


@pytest.mark.parametrize("case", OVERRIDDEN)
def test_what_a_file_says_may_be_overridden(case):
    method, options = OVERRIDDEN[case]
    found = running.solve(hertz(24), APPROACH, method, **options)
    assert found.converged
    assert found.load == pytest.approx(solve(hertz(24), approach=APPROACH).load, rel=1e-4)
    gone = [note for note in found.notes if "gives way to" in note]
    assert len(gone) == ("strategy" in case or "by a file" in case)


@pytest.mark.parametrize("kind", ["active_set", "fast", "tao"])
def test_an_option_at_its_default_asks_for_nothing(kind):
    defaults = {option.name: option.default for option in METHOD_OPTIONS} | {"lcp_type": kind}
    with ContactSolver(hertz(8), options=defaults) as solver:
        assert solver.settings.type == kind


def test_residual_of_the_reference_solvers_is_that_of_the_paper():
    found = running.solve(punch(24), 0.1, None, lcp_type="snesvi", lcp_max_it=1)
    e, h, contact = found.gap, found.undeformed_distance, found.contact
    assert found.residual == pytest.approx(
        np.linalg.norm(e[contact]) / np.linalg.norm(h[~np.isnan(h)]), rel=1e-9
    )
    assert (e[~contact] < 0).any()  # which counts against the solution, but is not in (5.1)


def test_a_later_method_file_is_that_method():
    files = {name: read_method_file(name) for name in ("fast", "fmg_v11")}
    alone = running.solve(hertz(24), APPROACH, "fmg_v11")
    assert running.solve(hertz(24), APPROACH, files).history["residual"] == alone.history["residual"]


def test_a_communicator_of_petsc4py_is_that_of_mpi4py():
    assert_same(
        solve(punch(24), approach=APPROACH, comm=PETSc.COMM_SELF),
        solve(punch(24), approach=APPROACH, comm=MPI.COMM_SELF),
    )


@pytest.mark.parametrize("case", OPTIONS)
def test_options_that_cannot_be(case):
    how, message = OPTIONS[case]
    gc.collect()
    before = communicators()
    with pytest.raises(InputError, match=message):
        ContactSolver(punch(24), **how)
    assert communicators() == before


@pytest.mark.parametrize(
    ("gap", "message"),
    [
        (np.zeros((8, 7)), r"\(8, 7\).*\(7, 8\)"),
        (np.zeros(56), r"\(56,\)"),
        (np.full((7, 8), np.inf), "must be numbers"),
        ([["a"] * 8] * 7, "array of real numbers"),
        (lambda x, y: 1 / (x - x), "must be numbers"),
        (np.full((7, 8), np.nan), "impossible in all cells"),
        (lambda x, y: np.zeros(3), "shape|broadcast"),
    ],
    ids=[
        "transposed",
        "flat",
        "infinite",
        "text",
        "infinite function",
        "no cell",
        "function of another shape",
    ],
)
def test_gap_that_cannot_be(gap, message):
    with np.errstate(all="ignore"), pytest.raises(InputError, match=message):
        solve(ContactProblem(Grid(8, 7, 1.0, 1.0), Material.combined(80000, 0.3), gap), approach=0.1)


@pytest.mark.parametrize("method", ["fast", "fmg_v11", "norm", "primal"])
def test_a_start_from_another_material_is_no_answer(method):
    """Its displacement is not that of its pressure here."""
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1), periodic=method == "primal")
    soft, hard = (
        ContactProblem(grid, Material.combined(modulus, 0.3), lambda x, y: (x**2 + y**2) / 40)
        for modulus in (80e3, 160e3)
    )
    other = solve(hard, approach=0.01, method=method)
    with ContactSolver(soft, method) as solver:
        expected, found = solver.solve(approach=0.01), solver.solve(approach=0.01, start=other)
    assert found.load == pytest.approx(expected.load, rel=1e-4)
    assert found.load == pytest.approx(other.load / 2, rel=1e-4)


def worn(problem, seed=1):
    """The same bodies, a little of each cell gone."""
    gap = problem.shape_on(problem.grid)
    depth = np.nanmax(gap) - np.nanmin(gap)
    gap = gap + 0.01 * depth * np.random.default_rng(seed).random(gap.shape)
    return ContactProblem(problem.grid, problem.material, gap, periodic=bool(problem.grid.periodic))


def wavy(n=32):
    grid = Grid.from_domain(n, n, (0, 1, 0, 1))
    return ContactProblem(
        grid,
        Material.combined(80000, 0.3),
        lambda x, y: 0.01 * (2 - np.cos(2 * np.pi * x) - np.cos(2 * np.pi * y)),
        periodic=True,
    )


UPDATED = {
    "fast": (lambda: punch(40), None, {"approach": APPROACH}),
    "load": (lambda: hertz(40), None, {"load": 5000.0}),
    "windows": (lambda: hertz(160), None, {"approach": APPROACH}),
    "fmg": (lambda: punch(24), "fmg_v11", {"approach": APPROACH}),
    "norm": (lambda: punch(24), "norm", {"approach": APPROACH}),
    "periodic": (wavy, None, {"mean_pressure": 200.0}),
}


@pytest.mark.parametrize("case", UPDATED)
def test_an_updated_solver_solves_as_a_new_one(case):
    make, method, loading = UPDATED[case]
    problem = make()
    other = worn(problem)
    with ContactSolver(other, method) as fresh:
        expected = fresh.solve(**loading)
    with ContactSolver(problem, method) as solver:
        before = solver.solve(**loading)
        gap = before.gap.copy()
        solver.update(other)
        after = solver.solve(**loading)
        started = solver.solve(**loading, start=before)
        np.testing.assert_array_equal(before.gap, gap)
        solver.update(problem)
        again = solver.solve(**loading)
    for found, wanted in ((after, expected), (again, before)):
        assert (found.load, found.approach, found.iterations) == (
            wanted.load,
            wanted.approach,
            wanted.iterations,
        )
        np.testing.assert_array_equal(found.pressure, wanted.pressure)
        np.testing.assert_allclose(found.gap, wanted.gap, rtol=0, atol=1e-15)  # bodies were moved since
    assert_solves_lcp(started)
    assert started.load == pytest.approx(after.load, rel=1e-4)
    assert started.approach == pytest.approx(after.approach, rel=1e-4)
    assert after.problem == expected.problem


def test_a_start_of_a_gap_that_was_elsewhere():
    """Its approach says nothing; looking for the load from there once cost the distances their digits."""
    grid, rng = Grid.from_domain(94, 90, (0, 1, 0, 1)), np.random.default_rng(3)
    material, gaps = Material.combined(80000, 0.3), 0.01 * rng.random((2, 90, 94)) + [[[5.0]], [[0.0]]]
    with ContactSolver(ContactProblem(grid, material, gaps[0])) as solver:
        before = solver.solve(mean_pressure=0.024)
        solver.update(ContactProblem(grid, material, gaps[1]))
        found, fresh = solver.solve(mean_pressure=15.0, start=before), solver.solve(mean_pressure=15.0)
    assert found.approach == pytest.approx(fresh.approach, rel=1e-4)
    np.testing.assert_allclose(found.undeformed_distance, gaps[1] - found.approach, rtol=0, atol=1e-14)


@pytest.mark.parametrize("periodic", [False, True], ids=["free", "periodic"])
@pytest.mark.parametrize("steps", [0.0, 1.0], ids=["flat", "terraces"])
def test_a_light_load_after_a_heavy_one_is_solved_as_if_it_were_the_first(periodic, steps):
    """A flat body, or a terrace, is where its last digit says: those that a deep approach costs are its contact."""
    grid, material = Grid(16, 12, 1.0, 0.1), Material.combined(80000, 0.3)
    gap = steps * (np.arange(16 * 12).reshape(12, 16) % 7 > 3)
    gap[3:5, 2:6] = np.nan
    problem = ContactProblem(grid, material, gap, periodic=periodic)
    with ContactSolver(problem) as solver:
        first, heavy, again = (solver.solve(mean_pressure=p) for p in (1e-9, 1e5, 1e-9))
    assert first.converged and heavy.indentation > 1e12 * first.indentation
    assert (again.converged, again.approach, again.error_bound) == (True, first.approach, first.error_bound)
    np.testing.assert_array_equal(again.pressure, first.pressure)


def test_a_start_may_have_pressure_where_an_updated_gap_has_a_hole():
    problem = hertz(64)
    with ContactSolver(problem) as solver:
        before = solver.solve(approach=APPROACH)
        gap = problem.shape_on(problem.grid)
        gap[28:36, 28:36] = np.nan
        assert before.contact[28:36, 28:36].any()
        solver.update(ContactProblem(problem.grid, problem.material, gap))
        found, fresh = solver.solve(approach=APPROACH, start=before), solver.solve(approach=APPROACH)
    assert_solves_lcp(found)
    assert_proved_equal(found, fresh)


@pytest.mark.parametrize(
    "other",
    [
        lambda: hertz(32),
        lambda: ContactProblem(hertz(24).grid, Material.combined(1.0, 0.3), np.zeros((24, 24))),
        lambda: ContactProblem(hertz(24).grid, hertz(24).material, np.full((24, 24), np.nan)),
        lambda: np.zeros((24, 24)),
    ],
    ids=["grid", "material", "holes", "array"],
)
def test_what_does_not_fit_leaves_the_solver_as_it_was(other):
    with ContactSolver(hertz(24)) as solver:
        before = solver.solve(approach=APPROACH)
        with pytest.raises(InputError, match=r"problem"):
            solver.update(other())
        assert_same(solver.solve(approach=APPROACH), before)


def test_a_path_is_that_of_one_problem():
    with ContactSolver(hertz(24)) as solver:
        path = iter(solver.path(load=[100.0, 200.0]))
        next(path)
        solver.update(worn(hertz(24)))
        with pytest.raises(InputError, match="another problem"):
            next(path)


@pytest.mark.parametrize("periodic", [False, True])
def test_bodies_moved_by_an_interrupted_solve_are_put_back(periodic, monkeypatch):
    """Ctrl-C in a move."""
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    problem = ContactProblem(grid, Material.from_contact_modulus(1e5), Sphere(10), periodic=periodic)

    def half_moved(distance, depth):
        distance.depth = depth
        raise KeyboardInterrupt

    with ContactSolver(problem) as solver:
        before = solver.solve(load=100)
        with monkeypatch.context() as patch:
            patch.setattr(UndeformedDistance, "move_to", half_moved)
            with pytest.raises(KeyboardInterrupt):
                solver.solve(load=3)
        after = solver.solve(load=100)
    assert after.approach == pytest.approx(before.approach, rel=1e-9)
    assert after.load == pytest.approx(before.load, rel=1e-12)
