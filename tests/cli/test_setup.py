"""`run/setup` on other people's checkouts."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from processes import TESTS

TREE = ("app", "petsc_options", "run", "pyproject.toml")
SOLVE = '. run/env && cd "$HOME" && mpiexec -n 2 contact-solve -options_file hertz.opts -grid 32 -output r.h5'


@pytest.fixture
def folder():
    """A folder that anybody may look into; those of pytest are of its user alone."""
    with tempfile.TemporaryDirectory(prefix="a path ") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.mark.parametrize("here", ["writable", "/proc"])
def test_demo_writes_where_it_can(folder, here):
    """Results go to results/, else to the current folder, else to a temporary one; nobody can write to /proc."""
    run, tools, here = folder / "run", folder / "tools", folder if here == "writable" else Path(here)
    for name, text in {
        "run/setup": "",
        "run/env": "",
        "tools/mpiexec": 'echo "$@"',
        "tools/python": 'echo "$@"',
    }.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    shutil.copy(TESTS.parent / "run/demo", run / "demo")
    (folder / "results").touch()  # in the way
    environment = {"PATH": f"{tools}:/usr/bin:/bin", "TMPDIR": str(folder)}
    done = subprocess.run(
        [run / "demo"], cwd=here, env=environment, capture_output=True, text=True, check=True
    )
    target = Path(done.stdout.partition("-output ")[2].partition("/hertz.h5")[0])
    assert target == here if here == folder else target.parent == folder and target.is_dir()
    assert f"Look at {target}/summary.png" in done.stdout


@pytest.mark.slow  # compiles the loops
@pytest.mark.skipif(os.getuid() != 0, reason="only root can run as somebody else")
def test_a_checkout_that_may_only_be_read_in_a_path_with_spaces_by_sh(folder):
    clone, home = folder / "a clone", folder / "home"
    for name in TREE:
        copy = shutil.copytree if (TESTS.parent / name).is_dir() else shutil.copy
        clone.mkdir(exist_ok=True)
        copy(TESTS.parent / name, clone / name)
    home.mkdir()
    os.chown(home, 65534, 65534)
    (home / "app.py").write_text("raise SystemExit(9)")  # is none of ours
    nobody = {"user": 65534, "group": 65534, "extra_groups": [], "cwd": clone}
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(home)}
    for line in ("sh run/setup", SOLVE):
        done = subprocess.run(
            ["sh", "-c", line], env=environment, capture_output=True, text=True, timeout=500, **nobody
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert (home / "r.h5").is_file()
    assert not (clone / ".venv").exists()


def test_pip_keeps_the_numpy_of_the_system():
    """Debian's packages are compiled for it."""
    constraints = Path(sys.prefix) / "constraints.txt"
    if not constraints.is_file():
        pytest.skip("not in the environment that run/setup makes")
    assert f"numpy=={np.__version__}" in constraints.read_text().split()
    listed = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True)
    assert f"install.constraint='{constraints.resolve().as_uri()}'" in listed.stdout
