"""docs/operator.md: its Python works, on one rank and on several, with SLEPc where it is installed."""

import re

import numpy as np
import pytest
from documents import code_blocks, run_blocks
from petsc4py import PETSc
from processes import TESTS

BLOCKS = code_blocks((TESTS.parent / "docs" / "operator.md").read_text(encoding="utf-8"))
WITH_SLEPC = [block for block in BLOCKS if "slepc4py" in block]
FIRST, DISTRIBUTED = BLOCKS[0], next(block for block in BLOCKS if "distributed" in block)


def test_python_of_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    *blocks, last = [block for block in BLOCKS if block not in WITH_SLEPC]
    names = run_blocks(blocks)
    assert names["ksp"].getConvergedReason() > 0
    assert names["multigrid"].getConvergedReason() > 0
    assert names["multigrid"].getIterationNumber() < 15
    assert names["again"].equal(names["pressure"])
    # A punch whose rim is made of cells is off by about a tenth of a cell of the radius.
    exact = 2 * names["steel"].contact_modulus * 2 * 0.01
    assert names["round_load"] == pytest.approx(exact, rel=0.1 * names["grid"].dx / 2 * 10)
    run_blocks([last], names)
    for options in (names["options"], PETSc.Options("mg_")):
        for name in options.getAll():
            options.delValue(name)


def test_slepc_of_the_page():
    pytest.importorskip("slepc4py")
    names = run_blocks([FIRST, *WITH_SLEPC])
    whole = np.zeros(names["operator"].local_shape)
    assert len(WITH_SLEPC) == 1
    assert np.all(np.diff(names["largest"]) <= 0)
    operator = names["operator"]
    operator.displacement(np.ones_like(whole), whole)
    assert names["largest"][0] == pytest.approx(whole.mean(), rel=0.1)  # of the smoothest wave
    names["mat"].destroy()


@pytest.mark.mpi(1, 2, 3)
def test_the_operator_on_several_ranks(comm):
    """The part for several ranks computes what the first one does."""
    names = run_blocks([FIRST, re.sub("MPI.COMM_WORLD", "comm_of_test", DISTRIBUTED)], {"comm_of_test": comm})
    assert names["u"].max()[1] == pytest.approx(names["displacement"].max()[1], rel=1e-12)
    for name in ("p", "u", "spread", "pressure", "displacement", "mat"):
        names[name].destroy()
