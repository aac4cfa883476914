"""docs/extending.md: its files, its Python and its commands work."""

import re
import shlex

import numpy as np
import pytest
from documents import code_blocks, run_blocks
from processes import TESTS, run

from app import solve
from app.reference.axisymmetric import Cone

TEXT = (TESTS.parent / "docs" / "extending.md").read_text(encoding="utf-8")
FILE = re.compile(r"# tests/extending/(\w+\.py)\n")
COMMANDS = [
    shlex.split(line)[1:]  # without "python"
    for block in code_blocks(TEXT, "sh")
    for line in block.replace("\\\n", " ").splitlines()
]


@pytest.fixture
def names(folder):
    """What the document's Python has computed."""
    return run_blocks([block for block in code_blocks(TEXT) if not FILE.match(block)])


def test_files_on_the_page_are_the_examples():
    files = {FILE.match(block)[1]: block for block in code_blocks(TEXT) if FILE.match(block)}
    assert files
    for name, block in files.items():
        assert block == (TESTS / "extending" / name).read_text(encoding="utf-8"), name


def test_python_of_the_document(names):
    for name in ("smoothed", "waves", "punch", "cone", "ball", "shifted", "by_minres"):
        assert names[name].converged, (name, names[name].message)
    exact = Cone.from_load(0.05, names["steel"].contact_modulus, 1e4)
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
    from preconditioner import Waves

    extended = []
    monkeypatch.setattr(Waves, "extend", lambda self, r: extended.append(r.any()))
    solution = solve(names["hertz"], approach=0.1091, options={"pc_python_type": "preconditioner.Waves"})
    assert solution.converged and any(extended)
    monkeypatch.delattr(Waves, "extend")
    assert solve(
        names["hertz"], approach=0.1091, options={"pc_python_type": "preconditioner.Waves"}
    ).converged


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
