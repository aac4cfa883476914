"""docs/coming-from.md: our code and that of other programs print the same numbers."""

import subprocess

import pytest
from documents import code_blocks, run_blocks
from processes import TESTS

from benchmarks.lines_of_code import write_inputs

TEXT = (TESTS.parent / "docs" / "coming-from.md").read_text(encoding="utf-8")
PACKAGES = "tamaas", "contactmechanics", "aspher"  # in the order of the page


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return folder


def test_our_code_runs_and_prints_the_numbers_of_the_page(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    names = run_blocks(code_blocks(TEXT))
    first = capsys.readouterr().out.split()
    assert all(f"{float(number):.5g}" in TEXT for number in first[1:4])  # of the rough surface
    assert any(f"{float(number):.6g}" == "201.596" for number in first), "the sphere of the free half-space"
    assert "201.596" in TEXT
    assert names["exact"].max_pressure == pytest.approx(float(first[-1]), rel=0.01)
    assert names["steel"].contact_modulus == 226e3 / 2


@pytest.mark.parametrize("package", PACKAGES)
def test_code_of_others_prints_the_numbers_of_the_page(package, folder):
    python = TESTS.parent / ".venv-peers" / package / "bin" / "python"
    if not python.exists():
        pytest.skip("not installed; run/bench-peers installs it")
    script = code_blocks(TEXT, "py")[PACKAGES.index(package)]
    done = subprocess.run([python, "-c", script], cwd=folder, capture_output=True, text=True, check=True)
    pressure, fraction, gap = map(float, done.stdout.splitlines()[-1].split()[:3])
    assert (pressure, fraction, gap) == pytest.approx((3681.48, 0.18982, 0.00038029), rel=1e-3)
