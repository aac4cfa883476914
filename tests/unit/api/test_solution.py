"""Solutions and their files."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest
from cases import APPROACH, hertz, punch

from app import ContactProblem, ContactSolver, Grid, Material, Solution, Sphere, read_result, solve
from app.api.solution import RUN_ATTRIBUTES
from app.api.summary import summary
from app.base import petsc
from app.base.errors import InputError


def test_a_solution_is_complete_and_frozen(tmp_path):
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


def test_a_result_file_may_have_more_fields(tmp_path):
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
            with pytest.raises(InputError, match=f"{name} exists already; choose another name"):
                found.save(tmp_path / "other.h5", **{name: value})
    columns = {"load": [1.0, 2.0], "approach": [1.0]}
    for steps, message in (
        (3, "steps: is int; must be columns by name"),
        ({"load": 1.0}, r"steps: column load: shape \(\), type float64; needed: a number for each step"),
        ({"load": ["a"]}, "column load: .*; needed: a number for each step"),
        (columns, r"column load: shape \(2,\), .*; needed: a number for each step"),
    ):
        with pytest.raises(InputError, match=message):
            found.save(tmp_path / "other.h5", steps)
    assert not (tmp_path / "other.h5").exists()


@pytest.mark.parametrize("shape", [(24, 1), (1, 24), (24, 16)])
def test_a_result_file_has_the_grid_of_its_solution(tmp_path, shape):
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


STEEL = Material.from_contact_modulus(1e5)
GRID = Grid.from_domain(8, 6, (-1, 1, -1, 1))
BALL = ContactProblem(GRID, STEEL, Sphere(10))


def test_masked_cells_of_a_field_are_nan_in_the_file(tmp_path):
    wear = np.ma.masked_greater(np.arange(48).reshape(GRID.shape), 7)
    solve(BALL, approach=0.001).save(tmp_path / "a.h5", wear=wear)
    np.testing.assert_array_equal(
        read_result(tmp_path / "a.h5").extra["wear"], wear.astype(float).filled(np.nan)
    )


def test_a_result_has_what_its_solution_has(tmp_path):
    pair = Material.pair((210e9, 3e9), (0.3, 0.3))
    found = solve(ContactProblem(GRID, pair, Sphere(10)), load=5e7)
    found.save(tmp_path / "found.h5")
    saved = read_result(tmp_path / "found.h5")
    assert repr(saved) == repr(found).replace("Solution", "Result")
    assert repr(found).endswith(", 2 notes: see .notes>")
    for name in ("load", "iterations", "message", "rtol", "error_bound", "notes", "converged"):
        assert getattr(saved, name) == getattr(found, name)
    assert (*saved.grid.shape, saved.grid.dx, saved.grid.y0) == pytest.approx((*GRID.shape, GRID.dx, GRID.y0))
    assert saved.contact_patches() == pytest.approx(found.contact_patches())
    assert saved.attributes.keys() - found.attributes.keys() == {"contact_patches", "largest_patch"}
    assert (saved.attributes["contact_patches"], saved.largest_patch) == (
        1,
        pytest.approx(found.contact_area),
    )
    for name in ("pressure", "gap"):
        for one, other in zip(saved.distribution(name), found.distribution(name), strict=True):
            np.testing.assert_array_equal(one, other)
    assert repr(pickle.loads(pickle.dumps(saved))) == repr(saved)
    assert not hasattr(saved, "nothing")
    assert {"load", "pressure", "message"} <= set(dir(saved))


def test_columns_of_a_path_keep_their_order_in_the_file(tmp_path):
    solution = solve(BALL, load=5)
    columns = {"step": [1, 2], "load": [2.0, 5.0], "approach": [1e-3, 2e-3], "contact_area": [0.1, 0.2]}
    solution.save(tmp_path / "path.h5", steps=columns)
    with h5py.File(tmp_path / "path.h5") as file:
        assert list(file["path"]) == list(columns)
    assert list(read_result(tmp_path / "path.h5").path) == list(columns)


def test_attributes_of_the_file_are_names_of_a_solution():
    found = solve(BALL, load=5)
    assert (found.reason, found.lcp_rtol) == (found.message, found.rtol)
    assert found.contact_modulus == found.attributes["contact_modulus"]
    assert {"message", "contact_modulus"} <= set(dir(found))
    with pytest.raises(AttributeError, match="has no max_pressur; did you mean max_pressure?"):
        _ = found.max_pressur
    for name, similar in (
        ("peak_pressure", r"max_pressure\?"),
        ("pressure_max", r"max_pressure\?"),
        ("resistance", r"(electrical|thermal)_conductance \(its reciprocal\)\?"),
        ("electrical_resistance", r"electrical_conductance \(its reciprocal\)\?"),
    ):
        with pytest.raises(AttributeError, match=f"has no {name}; did you mean {similar}"):
            getattr(found, name)
    assert found.stiffness is None and "stiffness" not in repr(found)  # which has the state only
    with pytest.raises(AttributeError, match="this solution has no nothing; what it has: .attributes"):
        _ = found.nothing


@pytest.mark.parametrize("name", [None, 3, "folder.h5/"])
def test_a_result_file_needs_a_name(name, tmp_path):
    with pytest.raises(InputError, match="result file"):
        solve(BALL, load=5).save(f"{tmp_path}/{name}" if isinstance(name, str) else name)


def test_the_gap_waits_for_a_solve_in_another_thread():
    found = solve(hertz(12), approach=APPROACH)
    with ThreadPoolExecutor(1) as pool:
        with petsc._LOCK:
            gap = pool.submit(lambda: found.gap)
            with pytest.raises(TimeoutError):
                gap.result(0.05)
        assert gap.result().shape == found.pressure.shape


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("numbers, texts, and arrays", lambda: solve(BALL, approach=0.001).save("x.h5", wear=[[1, 2], [3]])),
        ("'' is not allowed as a name", lambda: solve(BALL, approach=0.001).save("x.h5", **{"": 1})),
        ("'.' is not allowed as a name", lambda: solve(BALL, load=1).save("x.h5", **{".": np.zeros(GRID.shape)})),
    ],
)  # fmt: skip
def test_wrong_attributes_of_a_file_are_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("lift", [0.0, -0.3])
def test_the_indentation_counts_from_first_touch(tmp_path, periodic, lift):
    grid, steel = Grid.from_domain(32, 32, (-1, 1, -1, 1)), Material.from_contact_modulus(1e3)
    gap = np.random.default_rng(4).random(grid.shape) * 1e-2 + lift
    problem = ContactProblem(grid, steel, gap, periodic=periodic)
    with ContactSolver(problem) as solver:
        found = solver.solve(approach=gap.min() + 2e-3)
        assert found.indentation == pytest.approx(2e-3, rel=1e-9)
        assert solver.solve(approach=gap.min() - 1e-3).indentation == pytest.approx(-1e-3, rel=1e-9)
        path = solver.path(load=[found.load / 2, found.load])
        last = list(path)[-1]
    assert last.indentation == pytest.approx(2e-3, rel=1e-4)
    np.testing.assert_allclose(path.table["indentation"], path.table["approach"] - gap.min(), rtol=1e-9)
    last.save(tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").indentation == last.indentation
    assert ("beyond first touch" in summary(last.attributes | {"contact_patches": 1}, grid)) == (lift < 0)
