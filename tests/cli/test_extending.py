"""docs/extending.md: its files, its Python and its commands work."""

import re
import shlex
import shutil
import sys

import numpy as np
import pytest
from documents import code_blocks, run_blocks
from processes import OPTIONS, TESTS, run

from app import solve
from app.reference.axisymmetric import Cone

TEXT = (TESTS.parent / "docs" / "extending.md").read_text(encoding="utf-8")
FILE = re.compile(r"# (\w+\.py)\n")
COMMANDS = [
    shlex.split(line)[1:]  # without "python"
    for block in code_blocks(TEXT, "sh")
    for line in block.replace("\\\n", " ").splitlines()
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the files of the document, from which one works."""
    for block in code_blocks(TEXT):
        named = FILE.match(block)
        if named:
            (tmp_path / named[1]).write_text(block)
            monkeypatch.delitem(sys.modules, named[1].removesuffix(".py"), raising=False)
    shutil.copytree(OPTIONS, tmp_path / "petsc_options")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.fixture
def names(folder):
    """What the document's Python has computed."""
    return run_blocks([block for block in code_blocks(TEXT) if not FILE.match(block)])


def test_python_of_the_document(names):
    for name in ("smoothed", "waves", "punch", "cone"):
        assert names[name].converged, (name, names[name].message)
    modulus = names["steel"].contact_modulus
    exact = Cone.from_load(0.05, modulus, 1e4)
    assert names["cone"].approach == pytest.approx(exact.approach, rel=0.02)


def test_own_smoother_is_petsc_s_symmetric_sor(names):
    like = {
        "mg_levels_pc_sor_forward": "false",
        "mg_levels_pc_sor_symmetric": "",
        "mg_levels_pc_sor_omega": 0.9,
    }
    petsc = solve(names["hertz"], approach=0.1091, method="fmg_v11", options=like)
    assert names["smoothed"].iterations == petsc.iterations
    assert np.allclose(names["smoothed"].pressure, petsc.pressure, atol=1e-9 * petsc.max_pressure)


def test_own_preconditioner_is_the_one_used_and_feeds_the_predictor(names, monkeypatch):
    from my_waves import Waves

    extended = []
    monkeypatch.setattr(Waves, "extend", lambda self, r: extended.append(r.any()))
    solution = solve(names["hertz"], approach=0.1091, options={"pc_python_type": "my_waves.Waves"})
    assert solution.converged and any(extended)
    monkeypatch.delattr(Waves, "extend")
    assert solve(names["hertz"], approach=0.1091, options={"pc_python_type": "my_waves.Waves"}).converged


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[command.index("-grid") - 1])
@pytest.mark.ranks(2)
def test_commands_of_the_document(command, ranks, folder):
    done = run(*command, ranks=ranks, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert ": solved (" in done.stdout


def test_misspelt_option_of_an_own_part_is_told(folder):
    done = run(*COMMANDS[0], "-mg_levels_pc_sweeps_omgea", "1", cwd=folder)
    assert done.returncode == 2
    assert done.stderr == (
        "error: unknown or unused option: -mg_levels_pc_sweeps_omgea "
        "(did you mean -mg_levels_pc_sweeps_omega?)\n"
    )
