"""Many problems: the numbers of `solve`, in order, on one process or two; refusals before any work."""

import csv
import multiprocessing
import signal
import threading
from dataclasses import replace

import h5py
import numpy as np
import pytest
from cases import hertz, periodic_rough, punch

from app import ContactProblem, Grid, InputError, Material, Plane, read_result, solve, solve_many
from app.api import many
from app.contact.loading_input import LOADINGS

GRID = Grid.from_domain(24, 16, (0.0, 1.0, 0.0, 1.0))
STEEL, POLYMER = Material.combined(80000.0, 0.3), Material.combined(1000.0, 0.3)
SURFACES = 1e-3 * np.random.default_rng(3).random((5, 16, 24))
ON_GRID = {"grid": GRID, "material": STEEL}
pytestmark = pytest.mark.filterwarnings("ignore::app.NoteWarning")


class Failing(Plane):
    def shape_on(self, grid, rows=slice(None)):
        raise ZeroDivisionError("no such heights")


def assert_equal(one, other):
    """Compare all columns but times."""
    assert one.table.keys() == other.table.keys()
    for name in one.table.keys() - {"solve_seconds"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_rows_are_those_of_solve_in_order():
    problems = [
        punch(24),
        ContactProblem(GRID, STEEL, surfaces=[SURFACES[0]]),
        punch(24),
        ContactProblem(GRID, POLYMER, surfaces=[SURFACES[0]]),
        ContactProblem(GRID, STEEL, surfaces=[SURFACES[1]]),
    ]
    loads = [1e4, 50.0, 2e4, 1.0, 40.0]
    table = solve_many(iter(problems), loads)
    assert list(table["problem"]) == [0, 1, 2, 3, 4] and list(table["load"]) == loads and table.converged
    for row, problem, load in zip(table.rows, problems, loads, strict=True):
        expected = solve(problem, load=load)
        names = "approach", "max_pressure", "contact_area", "iterations", "operator_applications"
        assert [row[name] for name in names] == [getattr(expected, name) for name in names]


def test_problems_of_one_grid_and_material_share_a_solver(monkeypatch):
    made = []
    solver = many.ContactSolver
    monkeypatch.setattr(many, "ContactSolver", lambda *args: made.append(args) or solver(*args))
    solve_many([hertz(16), punch(16), hertz(16), punch(16)], approach=0.05)
    assert len(made) == 2


def test_problems_of_other_backgrounds_and_compliances():
    problems = [
        replace(punch(16), background_pressure=pressure, surface_compliance=compliance)
        for compliance in (0, 1e-6)
        for pressure in (0, 1)
    ]
    table = solve_many([*problems[::2], *problems[1::2]], approach=0.05)
    numbers = [solve(problem, approach=0.05).load for problem in (*problems[::2], *problems[1::2])]
    np.testing.assert_array_equal(table["load"], numbers)


@pytest.mark.parametrize(
    ("loads", "expected"),
    [
        (20, [(0, 20), (1, 20)]),
        (np.array([20.0, 30.0]), [(0, 20), (1, 30)]),
        ([[20, 30]], [(0, 20), (0, 30), (1, 20), (1, 30)]),
        ([[20, 30], [40]], [(0, 20), (0, 30), (1, 40)]),
        (np.array([[20.0], [30.0]]), [(0, 20), (1, 30)]),
    ],
)
def test_loads_are_one_for_all_or_one_or_several_for_each(loads, expected):
    table = solve_many(list(SURFACES[:2]), loads, **ON_GRID)
    assert list(zip(table["problem"], table["load"], strict=True)) == expected


@pytest.mark.parametrize("kind", ["approach", "mean_pressure", "mean_gap"])
def test_other_loadings(kind):
    problem = periodic_rough(32)
    prescribed = getattr(solve(problem, mean_pressure=100), kind)
    table = solve_many([problem], **{kind: prescribed})
    assert table[kind][0] == pytest.approx(prescribed) and table["mean_pressure"][0] == pytest.approx(100)


def test_two_processes_give_the_same_table_and_file(tmp_path):
    files = tmp_path / "one.h5", tmp_path / "two.h5"
    one, two = (
        solve_many(SURFACES, [[20, 30]], processes, **ON_GRID, output=file, fields=("pressure", "contact"))
        for processes, file in enumerate(files, 1)
    )
    assert_equal(one, two)
    with h5py.File(files[0]) as first, h5py.File(files[1]) as second:
        assert set(first) == {"pressure", "contact", "x", "y", "table"}
        assert first["pressure"].shape == (10, *GRID.shape)
        for name in ("pressure", "contact", "table/load", "table/message"):
            np.testing.assert_array_equal(first[name][()], second[name][()])
    assert not multiprocessing.active_children()


def test_file_has_the_fields_and_the_table(tmp_path):
    table = solve_many(SURFACES[:2], [20, 30], **ON_GRID, output=tmp_path / "fields.h5")
    with h5py.File(tmp_path / "fields.h5") as file:
        expected = solve(ContactProblem(GRID, STEEL, surfaces=[SURFACES[1]]), load=30)
        np.testing.assert_array_equal(file["pressure"][1], expected.pressure)
        np.testing.assert_array_equal(file["gap"][1], expected.gap)
        np.testing.assert_array_equal(file["x"], expected.x)
        np.testing.assert_array_equal(file["table/max_pressure"], table["max_pressure"])
        assert file["pressure"].attrs["unit"] == file["table/max_pressure"].attrs["unit"] == "N/mm2"


def test_file_has_fields_of_free_and_periodic_patches_and_is_no_result(tmp_path):
    path = tmp_path / "fields.h5"
    patches = [
        ContactProblem(**ON_GRID, surfaces=SURFACES[:1], periodic=which) for which in (False, "x", True)
    ]
    solve_many(patches, 20, output=path)
    with h5py.File(path) as file:
        assert file["pressure"].shape == (3, *GRID.shape)
    with pytest.raises(InputError, match="table of app.solve_many, no result"):
        read_result(path)


def test_an_error_leaves_the_old_file(tmp_path):
    path = tmp_path / "fields.h5"
    path.write_text("old")
    problems = [ContactProblem(GRID, STEEL, shape) for shape in (Plane(), Failing())]
    with pytest.raises(ZeroDivisionError):
        solve_many(problems, 10, output=path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_problems_that_fail_have_rows_that_say_so(tmp_path):
    """Contact is impossible everywhere: this shows when the shape is sampled."""
    surfaces = [SURFACES[0], np.full(GRID.shape, np.nan), SURFACES[1]]
    with pytest.warns(
        RuntimeWarning, match="2 of 6 rows not converged, of problems 1; the first: .*impossible"
    ):
        table = solve_many(surfaces, [[20, 30]], **ON_GRID, output=tmp_path / "fields.h5")
    assert list(table["converged"]) == [True, True, False, False, True, True] and not table.converged
    assert np.isnan(table["max_pressure"][2:4]).all() and list(table["load"]) == [20, 30] * 3
    assert "impossible" in table["message"][2]
    rest = solve_many(surfaces[::2], [[20, 30]], **ON_GRID)
    np.testing.assert_array_equal(np.delete(table["approach"], [2, 3]), rest["approach"])
    with h5py.File(tmp_path / "fields.h5") as file:
        assert np.isnan(file["pressure"][2:4]).all() and not np.isnan(file["pressure"][4]).any()


def test_iterates_that_have_not_converged_are_in_the_table():
    with pytest.warns(RuntimeWarning, match="not converged") as warned:
        table = solve_many([punch(24)], approach=0.1, method="norm", options={"lcp_max_it": 1})
    assert sum(warning.category is RuntimeWarning for warning in warned) == 1
    assert not table.converged and table["max_pressure"][0] > 0 and table["message"][0]


@pytest.mark.filterwarnings("default::app.NoteWarning")
def test_each_kind_of_notes_is_issued_once():
    with pytest.warns(UserWarning) as warned:
        table = solve_many([hertz(16)] * 3, approach=[0.5, 1, 2])  # contact reaches the rim
    assert all("boundary" in notes for notes in table["notes"])
    assert sum("boundary" in str(warning.message) for warning in warned) == 1


@pytest.mark.parametrize(
    ("problems", "arguments", "message"),
    [
        ([], {"loads": 1}, "problems: is empty"),
        (punch(16), {"loads": 1}, r"problems: is one ContactProblem; must be a sequence"),
        (SURFACES[0], {"loads": 1} | ON_GRID, r"is one ndarray; must be a sequence, \[array\]"),
        (SURFACES, {"loads": 1}, r"problems\[0\]: is ndarray; must be a ContactProblem, or a surface with grid="),
        (SURFACES, {"loads": 1, "grid": GRID}, "need material="),
        ([punch(16)], {"loads": 1} | ON_GRID, r"problems\[0\]: .* has its own grid"),
        ([*SURFACES, SURFACES[0][1:]], {"loads": 1} | ON_GRID, r"problems\[5\]: surface: has shape"),
        ([punch(16)], {}, "exactly one of"),
        ([punch(16)], {"loads": -1}, "load -1: .* at least 0"),
        ([punch(16)], {"loads": [1, "2"]}, "load: is str"),
        ([punch(16)] * 2, {"loads": [1, 2, 3]}, "load: 3 for 2 problems"),
        ([punch(16)] * 2, {"loads": [1, [2]]}, "numbers and lists"),
        ([punch(16)], {"mean_gap": 1}, "mean_gap: only on a periodic patch"),
        ([punch(16)], {"loads": 1, "processes": 0}, "processes 0: must be at least 1"),
        (
            [ContactProblem(GRID, STEEL, lambda x, y: x + y)],
            {"loads": 1, "processes": 2},
            r"problems\[0\]: cannot be sent to a process",
        ),
        ([punch(16)], {"loads": 1, "output": "fields.txt"}, "must end in .h5"),
        ([punch(16)], {"loads": 1, "output": "fields.h5", "fields": ("u",)}, "fields .*: must be among pressure"),
        ([punch(16), punch(24)], {"loads": 1, "output": "fields.h5"}, "on several grids"),
    ],
)  # fmt: skip
def test_wrong_input_is_refused_before_any_work(problems, arguments, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(many, "ContactSolver", None)
    with pytest.raises(InputError, match=message):
        solve_many(problems, **arguments)
    assert not list(tmp_path.iterdir())


def test_wrong_calls_show_a_right_one():
    with pytest.raises(TypeError, match=r"write solve_many\(problems, load=700\)"):
        solve_many(load=10)
    with pytest.raises(TypeError, match="unexpected argument 'loads'"):
        solve_many([punch(16)], 10, load=10)


class OfAnotherProgram:
    """Stands for a function of a notebook, which a process cannot find."""

    def __reduce__(self):
        return getattr, (Plane(), "roughness_of_mine")


def worker(arguments):
    """Start the loop of a worker in a thread; return the parent's end."""
    near, far = multiprocessing.Pipe()
    threading.Thread(target=many._work, args=(far, arguments), daemon=True).start()
    return near


def test_an_error_in_a_process_is_raised_by_the_parent(monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *args: None)  # a thread may not
    jobs = [many._Job(0, 0, ContactProblem(GRID, STEEL, Failing()), [1.0])]
    with (
        worker((LOADINGS["load"], ())) as connection,
        pytest.raises(ZeroDivisionError, match="no such heights") as caught,
    ):
        list(many._results([connection], iter([jobs])))
    assert "in a process of solve_many" in caught.value.__notes__[0]


def test_functions_that_a_process_cannot_find_are_wrong_input(monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *args: None)
    with (
        worker((LOADINGS["load"], ())) as connection,
        pytest.raises(InputError, match="roughness_of_mine.*in a module"),
    ):
        list(many._results([connection], iter([[OfAnotherProgram()]])))


def test_a_process_that_ends_early_is_an_error():
    near, far = multiprocessing.Pipe()
    far.close()
    with near, pytest.raises(RuntimeError, match="has ended unexpectedly"):
        list(many._results([near], iter([[1]])))


def test_table_has_units_and_can_be_saved(tmp_path):
    table = solve_many(SURFACES[:2], [20, 30], **ON_GRID)
    assert len(table) == 2 and table.units["load"] == "N" and "message" not in table.units
    table.save(tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        assert [float(row["approach"]) for row in csv.DictReader(file)] == list(table["approach"])
    with pytest.raises(InputError, match="must end in"):
        table.save(tmp_path / "table.doc")
    assert repr(table).startswith("2 rows, 0 not converged") and "max_pressure" in repr(table)
    assert "<table" in table._repr_html_()
    with pytest.raises(KeyError):
        table["pressures"]
    import pandas

    frame = table.to_dataframe()
    assert isinstance(frame, pandas.DataFrame) and frame.attrs["units"]["approach"] == "mm"
    assert list(frame["load"]) == [20, 30]


def test_plastic_columns_and_fields_are_of_problems_with_a_hardness(tmp_path):
    problems = [hertz(16), replace(hertz(16), hardness=1000.0)]
    rows = solve_many(problems, [9e4, 9e4], output=tmp_path / "many.h5", fields=["plastic", "plastic_depth"])
    assert np.isnan(rows["plastic_area"][0]) and rows["plastic_area"][1] > 0
    with h5py.File(tmp_path / "many.h5") as file:
        assert np.isnan(file["plastic_depth"][0]).all() and not file["plastic"][0].any()
        area = problems[0].grid.cell_area
        assert file["plastic_depth"][1].sum() * area == pytest.approx(rows["plastic_volume"][1])
