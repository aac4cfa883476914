"""Files that appear whole or not at all: links, inputs, long names, what killed runs leave."""

import os
import subprocess
import sys
import time
import tracemalloc
from types import SimpleNamespace

import pytest
from mpi4py import MPI
from results import made_up_result
from results import write as write_made_up

from app.base.errors import InputError
from app.cli.load_path import hash_inputs
from app.io.files import atomic_file, check_output_path, make_temporary_name
from app.io.result import read_result
from app.parallel.slabs import Slabs
from app.parameter_study.run import Run


def write(path, text):
    with atomic_file(path) as temporary:
        temporary.write_text(text)


def test_output_must_not_be_an_input(tmp_path):
    gap, other = tmp_path / "gap.h5", tmp_path / "other.h5"
    gap.write_text("measured")
    (tmp_path / "link.h5").symlink_to(gap)
    (tmp_path / "hard.h5").hardlink_to(gap)
    (tmp_path / "folder").symlink_to(tmp_path)
    for name in ("gap.h5", "link.h5", "hard.h5", "folder/gap.h5", f"../{tmp_path.name}/gap.h5"):
        with pytest.raises(ValueError, match=rf"is the input {gap}") as refusal:
            check_output_path(tmp_path / name, [tmp_path / "absent", gap])
        assert str(tmp_path / name) in str(refusal.value)
    assert check_output_path(other, [gap]) == other


def test_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    target, link = tmp_path / "elsewhere" / "target.h5", tmp_path / "link.h5"
    link.symlink_to("elsewhere/target.h5")
    for text in ("new", "newer"):  # the first time the link leads nowhere
        assert check_output_path(link) == target
        write(link, text)
        assert link.is_symlink()
        assert target.read_text() == text
        assert list((tmp_path / "elsewhere").iterdir()) == [target]


def test_link_that_leads_to_no_file(tmp_path):
    (tmp_path / "self.h5").symlink_to(tmp_path / "self.h5")
    (tmp_path / "away.h5").symlink_to(tmp_path / "absent" / "a")
    (tmp_path / "up.h5").symlink_to(tmp_path)
    for name, reason in (
        ("self", "leads to itself"),
        ("away", "absent does not exist"),
        ("up", "not a regular file"),
    ):
        with pytest.raises(ValueError, match=reason):
            check_output_path(tmp_path / f"{name}.h5")


def test_files_of_other_users_in_a_sticky_folder(tmp_path, monkeypatch):
    """As in /tmp: a file can be made beside them, but the rename in the end would be refused, when all is done."""
    path = tmp_path / "result.h5"
    tmp_path.chmod(0o1777)
    path.touch()
    assert check_output_path(path) == path
    monkeypatch.setattr(os, "geteuid", lambda: path.stat().st_uid + 1)
    with pytest.raises(InputError, match=r"result\.h5: is another user's"):
        check_output_path(path)
    assert check_output_path(tmp_path / "other.h5") == tmp_path / "other.h5"
    tmp_path.chmod(0o777)
    assert check_output_path(path) == path


def test_every_name_that_the_folder_takes_can_be_written(tmp_path):
    longest = os.pathconf(tmp_path, "PC_NAME_MAX")
    path = check_output_path(tmp_path / ("a" * (longest - 3) + ".h5"))
    write(path, "content")
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(ValueError, match="File name too long"):
        check_output_path(tmp_path / ("a" * (longest - 2) + ".h5"))


def test_what_killed_runs_leave_is_cleared_by_the_next(tmp_path):
    """Whatever they wrote, when it is a day old: nothing of runs that live, or of somebody else."""
    path = tmp_path / "result.h5"
    killed = (
        "import os, signal, sys; from pathlib import Path; from app.io.files import atomic_file\n"
        "with atomic_file(Path(sys.argv[1], 'result.h5')) as one, atomic_file(Path(sys.argv[1], 'b.csv')) as two:\n"
        "    one.write_text('half'); two.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", killed, tmp_path], timeout=60).returncode == -9
    left = set(tmp_path.iterdir())
    assert len(left) == 2
    others = {make_temporary_name(path), tmp_path / "notes.tmp"}
    for other in others:
        other.write_text("not ours to remove")
    write(path, "whole")
    assert set(tmp_path.iterdir()) == {path, *left, *others}
    for file in *left, tmp_path / "notes.tmp":
        os.utime(file, (0, time.time() - 2 * 86400))
    write(path, "whole")
    assert set(tmp_path.iterdir()) == {path, *others}


@pytest.mark.parametrize("of", ["path", "sweep"])
def test_no_input_is_held_in_memory_to_be_told_from_another(tmp_path, of):
    """Measured surfaces are large, and rank 0 of a path has work arrays beside them."""
    size, file = 32 << 20, tmp_path / "surface.npy"
    with file.open("wb") as large:
        large.truncate(size)
    path = SimpleNamespace(
        inputs=[file, tmp_path / "absent"], relevant_options="", kind="load", numbers=(1.0,)
    )
    keys, run = [], Run(options={"surface_file": str(file)})
    for end in b"", b"\1":
        with file.open("ab") as large:
            large.write(end)
        tracemalloc.start()
        keys.append(hash_inputs(path, SimpleNamespace(comm=MPI.COMM_SELF)) if of == "path" else run.key())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < size / 4
    assert keys[0] != keys[1]


def test_ctrl_c_while_a_result_is_written_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("app.io.write.publish", lambda *paths: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_made_up(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(12), made_up_result(16, 12))
    assert not list(tmp_path.iterdir())


def test_temporary_names_are_all_different(tmp_path):
    assert len({make_temporary_name(tmp_path / name) for name in ("a.h5", "a.h5", "b.h5")}) == 3


def test_result_file_whose_links_go_in_a_circle(tmp_path):
    import h5py

    with h5py.File(tmp_path / "loop.h5", "w") as file:
        file["pressure"] = h5py.SoftLink("/pressure")
        file["gap"] = [[1.0]]
    with pytest.raises(ValueError, match=r"loop\.h5: ") as refusal:
        read_result(tmp_path / "loop.h5")
    assert "\n" not in str(refusal.value)
