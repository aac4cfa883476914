"""Result files: exact round trips, whole files or none, errors in one line."""

import os
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from processes import TESTS, run
from results import assert_same, full_disk, made_up_result, write

from app.base.errors import InputError
from app.io.files import atomic_file, check_output_path
from app.io.result import FIELDS, read_result
from app.parallel.slabs import Slabs

SELF = MPI.COMM_SELF
DATASETS = ["pressure", "gap", "displacement", "undeformed_distance", "contact", "x", "y"]
COLUMNS = ["level", "contact_cells", "changed_cells", "residual", "inner_iterations", "work_units"]
ATTRIBUTES = (
    "converged reason active_set_iterations work_units operator_applications inner_iterations residual load "
    "approach max_pressure contact_cells contact_fraction solve_seconds setup_seconds ranks options "
    "command_line version"
).split()


@pytest.fixture(scope="module")
def result():
    return made_up_result(64, 48, punch_radius=4.5)


@pytest.fixture
def path(result, tmp_path):
    write(tmp_path / "result.h5", SELF, Slabs(48), result)
    return tmp_path / "result.h5"


def test_round_trip_is_exact(result, tmp_path):
    odd = replace(result, pressure=result.pressure.copy(), gap=result.gap.copy())
    odd.pressure[0, :3] = -0.0, 5e-324, np.inf
    assert np.isnan(odd.gap).any()
    extra = {name: getattr(odd, name) for name in FIELDS} | {"slip": 2 * odd.displacement}
    write(tmp_path / "a.hdf5", SELF, Slabs(48), odd, fields=extra)
    found = read_result(tmp_path / "a.hdf5")
    assert found.units["slip"] == "1"
    assert found.extra.pop("slip").shape == (48, 64)
    assert_same(found, odd)


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


def test_no_outer_iteration_gives_empty_columns(result, tmp_path):
    write(tmp_path / "a.h5", SELF, Slabs(48), result, history={})
    assert {
        name: column.shape for name, column in read_result(tmp_path / "a.h5").history.items()
    } == dict.fromkeys(COLUMNS, (0,))


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
def test_reading_refuses_what_nobody_can_draw(path, name, values, message):
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


def as_fields(result):
    return {name: getattr(result, name) for name in FIELDS}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: {"attributes": r.attributes | {"reason": None}}, "attribute reason: object"),
        (lambda r: {"fields": as_fields(r) | {"slip": r.gap * 1j}}, "field slip: complex128 is not numeric"),
        (lambda r: {"steps": {"load": [1.0], "approach": [1.0, 2.0]}}, "steps: column load: shape"),
    ],
)
def test_writing_refuses_what_does_not_fit(result, path, change, message):
    before = path.read_bytes()
    with pytest.raises(ValueError, match=message):
        write(path, SELF, Slabs(48), result, **change(result))
    assert path.read_bytes() == before
    assert [f.name for f in path.parent.iterdir()] == [path.name]


def test_a_mistake_of_the_program_is_raised_as_it_is(result, path):
    with pytest.raises(AttributeError, match="NoneType"):
        write(path, SELF, Slabs(48), result, fields=None)


def test_full_disk_leaves_the_previous_result(result, path):
    before = path.read_bytes()
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write(path, SELF, Slabs(48), result)
    assert path.read_bytes() == before
    assert [f.name for f in path.parent.iterdir()] == [path.name]


def test_killed_run_leaves_the_previous_result(path):
    """The process dies when all is written and only the renaming is left."""
    before = path.read_bytes()
    program = (
        "import os, signal, sys; from mpi4py import MPI; from app.parallel.slabs import Slabs\n"
        "import results as m\n"
        "os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL)\n"
        "m.write(sys.argv[1], MPI.COMM_SELF, Slabs(96), m.made_up_result())\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])}
    run = subprocess.run([sys.executable, "-c", program, path], env=environment, timeout=60, check=False)
    assert run.returncode == -9
    assert path.read_bytes() == before


def test_whole_file_appears_only_when_the_block_succeeds(tmp_path):
    target = tmp_path / "t.txt"
    target.write_text("old")
    with pytest.raises(KeyError), atomic_file(target) as temporary:
        temporary.write_text("half")
        raise KeyError
    assert target.read_text() == "old"
    with atomic_file(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_output_path_is_checked_early(tmp_path):
    assert check_output_path(str(tmp_path / "a.H5")) == tmp_path / "a.H5"
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "folder.h5").mkdir()
    for name, reason in (
        (tmp_path / "a.txt", r"must end in \.h5 or \.hdf5"),
        (tmp_path / "a", "must end in"),
        (tmp_path / "folder.h5", "not a regular file"),
        (tmp_path / "absent" / "a.h5", "does not exist"),
        ("/proc/a.h5", "cannot write in /proc"),  # not even root can
    ):
        with pytest.raises(ValueError, match=reason) as caught:
            check_output_path(name)
        assert str(name) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_who_reads_a_result_waits_for_no_solver():
    """Neither MPI nor PETSc nor the compiler are loaded, nor by who draws it."""
    slow = "{'mpi4py.MPI', 'petsc4py', 'numba'}"
    done = run("-c", f"import sys; import app.plot, app.report; print(*{slow} & sys.modules.keys())")
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "", "")
