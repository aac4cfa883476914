"""benchmarks/peers/adapters/contact_adapter.py with a program in place of CONTACT whose answer is known."""

import stat
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from app.halfspace.material import Material
from benchmarks.peers.packages import Unavailable, install
from benchmarks.peers.runs import Solver

# Its pressure is the overlap at an approach of 0.02, by load too. Lines are as CONTACT prints them.
PROGRAM = """\
#!{python}
import sys
from pathlib import Path
words = [line.split() for line in Path("a.inp").read_text().splitlines()]
if words[0][0] == "0":
    Path("a.out").write_text("Version: $Revision: 2707 $, $Date:: 2025-07-23$")
    sys.exit()
nx, ny = int(words[9][0]), int(words[9][1])
gap = [float(word[0]) for word in words[11:-1]]
assert len(gap) == nx * ny and words[-1][0] == "0"
rows = ["%    I    IGS    H    MU    PN"]
rows += [f"{{i + 1}} 1 {{h}} 0. {{0.02 - h:.6g}}" for i, h in enumerate(gap) if h < 0.02]
Path("a.0001.mat").write_text("% TIM\\n 0.0\\n" + "\\n".join(rows) + "\\n")
seconds = {{"Algorithm Norm": 0.03, "Norm: ConjGrd solver": 0.02, "Influence coeffic.": 1e-5 * nx * ny}}
timers = [f"|{{name:21}} |   1 | {{time:.{decimals}f}} | 50.0 | 9.9 | 50.0 |" for name, time in seconds.items()]
Path("a.out").write_text("\\n".join(["Norm: final element division: C, E=  1  2  ItCG=     7", *timers]))
"""


@pytest.fixture
def solve(tmp_path, monkeypatch):
    """Return a function that runs the adapter on a variant, and what the file of the problem holds."""
    rng = np.random.default_rng(1)
    material = Material.combined(1000.0, 0.3)
    x, y = np.arange(14.0), np.arange(9.0)
    gap = 0.3 + 0.002 * ((x - 4.3) ** 2 + 1.5 * (y[:, None] - 5.1) ** 2) + 0.001 * rng.random((9, 14))
    gap[5, 4] = np.nan
    known = {"gap": gap, "dx": 1.0, "dy": 0.5, "approach": np.nanmin(gap) + 0.02, "load": 1.0}
    known |= {"contact_modulus": material.contact_modulus, "shear_modulus": 1000.0, "poisson_ratio": 0.3}
    np.savez(tmp_path / "problem.npz", **known, hardness=np.inf, thickness=np.inf, dilute=False)
    program = tmp_path / "program"

    def run(variant, decimals=5):
        program.write_text(PROGRAM.format(python=sys.executable, decimals=decimals))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("CONTACT_EXE", str(program))
        case = SimpleNamespace(file=tmp_path / "problem.npz", judge=lambda pressure, control: {})
        options = SimpleNamespace(budget=20, limit=120)
        solver = Solver(sys.executable, "contact", "", variant, "", case.file, options)
        return solver.run(case, tmp_path, 1e-5)

    return run, known


@pytest.mark.parametrize("variant", ["BCCG", "BCCG by load"])
def test_pressures_are_in_the_cells_that_they_belong_to(solve, variant):
    run, known = solve
    measured, pressure = run(variant)
    assert not measured.failure
    overlap = np.nan_to_num(np.maximum(known["approach"] - known["gap"], 0))
    assert np.allclose(pressure, overlap, rtol=1e-5, atol=1e-9)
    # by load it cannot know the contact beforehand, so there is a margin
    spans = [np.ptp(np.flatnonzero((overlap > 0).any(axis))) + 1 + 2 * ("load" in variant) for axis in (0, 1)]
    assert measured.iterations == 7
    assert measured.seconds == pytest.approx(0.02)
    assert measured.setup_seconds == pytest.approx(0.01 + 1e-5 * spans[0] * spans[1])


def test_timers_without_decimals_are_an_error(solve):
    run, _ = solve
    measured, pressure = run("BCCG", decimals=1)
    assert pressure is None
    assert "CONTACT must print its timers with four or more decimals" in measured.failure


@pytest.mark.parametrize("path", ["", "contact", "/no/such/file"])
def test_without_its_path_contact_is_left_out(monkeypatch, tmp_path, path):
    monkeypatch.setenv("CONTACT_EXE", path)
    with pytest.raises(Unavailable, match="^CONTACT_EXE must be the absolute path of its executable$"):
        install("contact", tmp_path)
