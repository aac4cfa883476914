"""Viewers of options of PETSc."""

import pytest
from cases import hertz

from app import ContactSolver
from app.base.errors import InputError

PROBLEM = hertz(16)
SNESVI = {"snesvi": {"lcp_type": "snesvi"}}
NOT_SHOWN = ["::ascii_info_detail", "::ascii_xml", "binary:x", "hdf5:x"]
NOT_DRAWN = [f"ksp_monitor_{name}" for name in ("short", "range", "max", "singular_value")]


@pytest.mark.parametrize("method", [None, "norm", "mg_v11"])
@pytest.mark.parametrize(
    "name", ["ksp_monitor", "ksp_monitor_true_residual", *NOT_DRAWN, "mg_levels_ksp_monitor"]
)
def test_monitors_that_crash_petsc_are_refused(method, name):
    for view in NOT_SHOWN + ["draw"] * (name in NOT_DRAWN):
        with pytest.raises(InputError, match=f"^-{name} {view}: "):
            ContactSolver(PROBLEM, method, {name: view})


def test_a_reason_with_a_format_that_crashes_petsc_is_refused():
    with pytest.raises(InputError, match="^-snes_converged_reason ::ascii_info_detail: "):
        ContactSolver(PROBLEM, SNESVI, {"snes_converged_reason": "::ascii_info_detail"})


def test_a_monitor_may_write_text_to_a_file(tmp_path):
    for view in (f":{tmp_path / 'Text'}", f"ascii:{tmp_path / 'Text'}:default"):
        with ContactSolver(PROBLEM, "norm", {"ksp_monitor": view}) as solver:
            solver.solve(approach=0.1)
        assert "KSP Residual norm" in (tmp_path / "Text").read_text()
