"""Writing of result files."""

import os
import subprocess
import sys

import pytest
from mpi4py import MPI
from processes import TESTS
from results import full_disk, made_up_result, write
from results import write as write_made_up

from app.io.result import FIELDS, read_result
from app.parallel.slabs import Slabs


def test_interrupted_writing_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr("app.io.write.publish", lambda *paths: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_made_up(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(12), made_up_result(16, 12))
    assert not list(tmp_path.iterdir())


SELF = MPI.COMM_SELF
COLUMNS = ["level", "contact_cells", "changed_cells", "residual", "inner_iterations", "work_units"]


def test_history_without_iterations_is_empty(result, tmp_path):
    write(tmp_path / "a.h5", SELF, Slabs(48), result, history={})
    assert {
        name: column.shape for name, column in read_result(tmp_path / "a.h5").history.items()
    } == dict.fromkeys(COLUMNS, (0,))


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
def test_writing_refuses_wrong_shapes_and_types(result, path, change, message):
    before = path.read_bytes()
    with pytest.raises(ValueError, match=message):
        write(path, SELF, Slabs(48), result, **change(result))
    assert path.read_bytes() == before
    assert [f.name for f in path.parent.iterdir()] == [path.name]


def test_bug_propagates_unchanged(result, path):
    with pytest.raises(AttributeError, match="NoneType"):
        write(path, SELF, Slabs(48), result, fields=None)


def test_full_disk_keeps_the_previous_result(result, path):
    before = path.read_bytes()
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write(path, SELF, Slabs(48), result)
    assert path.read_bytes() == before
    assert [f.name for f in path.parent.iterdir()] == [path.name]


def test_killed_run_keeps_the_previous_result(path):
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
