"""Atomic files, links, inputs, long names and outdated temporary files."""

import os
import subprocess
import sys
import time

import pytest

from app.base.errors import InputError
from app.io.files import atomic_file, check_output_path, make_temporary_name


def write(path, text):
    with atomic_file(path) as temporary:
        temporary.write_text(text)


def test_output_is_no_input(tmp_path):
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


def test_broken_links_are_refused(tmp_path):
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


def test_files_of_other_users_in_a_sticky_folder_are_refused(tmp_path, monkeypatch):
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


def test_longest_possible_name_can_be_written(tmp_path):
    longest = os.pathconf(tmp_path, "PC_NAME_MAX")
    path = check_output_path(tmp_path / ("a" * (longest - 3) + ".h5"))
    write(path, "content")
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(ValueError, match="File name too long"):
        check_output_path(tmp_path / ("a" * (longest - 2) + ".h5"))


def test_outdated_temporary_files_are_removed(tmp_path):
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


def test_temporary_names_are_unique(tmp_path):
    assert len({make_temporary_name(tmp_path / name) for name in ("a.h5", "a.h5", "b.h5")}) == 3


def test_atomic_file_appears_only_if_the_block_succeeds(tmp_path):
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


def test_output_path_is_checked(tmp_path):
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
