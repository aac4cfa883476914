"""Result files that cannot be read."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from processes import run
from results import assert_same, write

from app import ContactProblem, Grid, Material, Paraboloid, solve
from app.base.errors import InputError
from app.io.result import FIELDS, read_result
from app.parallel.slabs import Slabs


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("result file: is NoneType; must be a path", lambda: read_result(None)),
        ("no such file", lambda: read_result("nothing.h5")),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(message, call):
    with pytest.raises(InputError, match=message) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_circular_links_in_a_result_are_refused(tmp_path):
    import h5py

    with h5py.File(tmp_path / "loop.h5", "w") as file:
        file["pressure"] = h5py.SoftLink("/pressure")
        file["gap"] = [[1.0]]
    with pytest.raises(ValueError, match=r"loop\.h5: ") as refusal:
        read_result(tmp_path / "loop.h5")
    assert "\n" not in str(refusal.value)


SELF = MPI.COMM_SELF
DATASETS = ["pressure", "gap", "displacement", "undeformed_distance", "contact", "x", "y"]
COLUMNS = ["level", "contact_cells", "changed_cells", "residual", "inner_iterations", "work_units"]
ATTRIBUTES = (
    "converged reason active_set_iterations work_units operator_applications inner_iterations residual load "
    "approach max_pressure contact_cells contact_fraction solve_seconds setup_seconds ranks options "
    "command_line version"
).split()


def test_round_trip_is_exact(result, tmp_path):
    odd = replace(result, pressure=result.pressure.copy(), gap=result.gap.copy())
    odd.pressure[0, :3] = -0.0, 5e-324, np.inf
    assert np.isnan(odd.gap).any()
    extra = {name: getattr(odd, name) for name in FIELDS} | {"wear": 2 * odd.displacement}
    write(tmp_path / "a.hdf5", SELF, Slabs(48), odd, fields=extra)
    found = read_result(tmp_path / "a.hdf5")
    assert found.units["wear"] == "1"
    assert found.extra.pop("wear").shape == (48, 64)
    assert_same(found, odd)


def test_contact_selects_cells_like_that_of_a_solution(tmp_path):
    from app import ContactProblem, Grid, Material, Sphere, solve

    grid = Grid.from_domain(16, 12, (-0.1, 0.1, -0.1, 0.1))
    solution = solve(
        ContactProblem(grid, Material.isotropic(210e3, 0.3), Sphere(1.0), hardness=5e3), load=50.0
    )
    solution.save(tmp_path / "a.h5")
    found = read_result(tmp_path / "a.h5")
    for name in ("contact", "plastic"):
        cells, same = getattr(solution, name), getattr(found, name)
        assert same.dtype == cells.dtype == bool
        assert np.array_equal(found.pressure[same], solution.pressure[cells])


def test_names_types_and_units_are_those_of_the_interface(path):
    with h5py.File(path) as file:
        assert sorted(file) == sorted([*DATASETS, "history"])
        assert sorted(file["history"]) == sorted(COLUMNS)
        assert file.attrs.keys() >= set(ATTRIBUTES)
        for name in DATASETS:
            assert file[name].dtype == ("uint8" if name == "contact" else "float64")
            assert file[name].shape == {"x": (64,), "y": (48,)}.get(name, (48, 64))
            assert file[name].attrs["unit"] == {"pressure": "N/mm2", "contact": "1"}.get(name, "mm")
        assert file.attrs["converged"].dtype == bool


@pytest.mark.parametrize("name", [*DATASETS, *(f"history/{c}" for c in COLUMNS), *ATTRIBUTES])
def test_reading_names_what_is_missing(path, name):
    with h5py.File(path, "r+") as file:
        del (file.attrs if name in file.attrs else file)[name]
    with pytest.raises(ValueError, match=rf"result\.h5: (dataset|attribute) {name} is missing$"):
        read_result(path)


def test_reading_refuses_other_files(path, tmp_path):
    whole = path.read_bytes()
    for content, reason in (
        (b"not HDF5", "not a readable HDF5"),
        (b"", "not a readable HDF5"),
        (whole[:5000], ""),
    ):
        (tmp_path / "other.h5").write_bytes(content)
        with pytest.raises(ValueError, match=f"other.h5: .*{reason}") as caught:
            read_result(tmp_path / "other.h5")
        assert "\n" not in str(caught.value)
    for other, reason in ((tmp_path, "not a file"), (tmp_path / "absent.h5", "no such file")):
        with pytest.raises(ValueError, match=reason):
            read_result(other)
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["elevation"] = np.zeros((3, 3))
    with pytest.raises(ValueError, match="no result of app.solve"):
        read_result(tmp_path / "foreign.h5")
    with h5py.File(path, "r+") as file:
        del file["gap"]
        file["gap"] = np.zeros((48, 63))
    with pytest.raises(ValueError, match=r"dataset gap: shape \(48, 63\)"):
        read_result(path)
    with h5py.File(path, "r+") as file:
        del file["gap"]
        file["gap"] = np.zeros((48, 64), dtype="S3")
    with pytest.raises(ValueError, match=r"dataset gap: type \|S3"):
        read_result(path)


@pytest.mark.parametrize("where", ["attribute", "dataset"])
def test_reading_refuses_types_that_numpy_has_not(path, where):
    with h5py.File(path, "r+") as file:
        if where == "attribute":
            h5py.h5a.create(file.id, b"when", h5py.h5t.UNIX_D32LE, h5py.h5s.create(h5py.h5s.SCALAR))
        else:
            h5py.h5d.create(file.id, b"when", h5py.h5t.UNIX_D32LE, file["gap"].id.get_space())
    with pytest.raises(InputError, match="result.h5: No NumPy equivalent"):
        read_result(path)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("x", np.linspace(9, -9, 64), "x: needed: finite cell centres"),
        ("x", np.zeros(64), "x: needed: finite cell centres"),
        ("x", np.full(64, np.nan), "x: needed: finite cell centres"),
        ("y", np.geomspace(1, 9, 48), "y: needed: finite cell centres"),
        ("y", np.linspace(-1e200, 1e200, 48), "y: needed: finite cell centres"),
        ("contact", np.full((48, 64), 2, np.uint8), "contact: has other values than 0 and 1"),
        ("path/approach", np.zeros(3), "path: has no loads"),
        ("path/load", np.zeros(0), "path: has no loads"),
    ],
)
def test_reading_refuses_invalid_values(path, name, values, message):
    with h5py.File(path, "r+") as file:
        if name in file:
            del file[name]
        file[name] = values
    with pytest.raises(ValueError, match=f"{path.name}: .*{message}"):
        read_result(path)


def test_cell_centres_far_from_zero_are_read(path):
    """Rounding makes steps of cells that lie far away unequal."""
    with h5py.File(path, "r+") as file:
        file["x"][...] = 1e6 + 1e-8 * np.arange(64)
    assert read_result(path).x[0] == 1e6


def test_reading_a_result_imports_no_solver():
    slow = "{'mpi4py.MPI', 'petsc4py', 'numba'}"
    done = run("-c", f"import sys; import app.plot, app.report; print(*{slow} & sys.modules.keys())")
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")


def test_a_solve_that_saves_nothing_imports_no_h5py():
    """Its import takes as long as a small solve."""
    program = "import sys; import app.api.solver, app.api.refinement, app.cli.load_path; print('h5py' in sys.modules)"
    assert run("-c", program).stdout.strip() == "False"


def test_load_path_is_read_from_a_result(path):
    with h5py.File(path, "r+") as file:
        file["path/load"] = [3.0, 4.0]
    assert read_result(path).path["load"].tolist() == [3, 4]


def test_fields_have_dimension_scales(path):
    with h5py.File(path) as file:
        for name in ("pressure", "gap", "displacement", "undeformed_distance", "contact"):
            assert [dimension[0].name for dimension in file[name].dims] == ["/y", "/x"]
        assert all(h5py.h5ds.is_scale(file[name].id) for name in ("x", "y"))


def test_attributes_of_a_result_are_json_as_those_of_a_solution(tmp_path):
    material = Material.coated((2e5, 1e5), (0.3, 0.3), thickness=0.05)
    grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
    solution = solve(ContactProblem(grid, material, Paraboloid(9, 7)), load=100)
    solution.save(tmp_path / "r.h5")
    read = json.dumps(read_result(tmp_path / "r.h5").attributes)
    back, expected = json.loads(read), json.loads(json.dumps(solution.attributes))
    assert {name: repr(back[name]) for name in expected} == {name: repr(expected[name]) for name in expected}
