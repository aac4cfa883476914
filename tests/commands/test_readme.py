"""What README.md and pages of docs/ show is run; the version is the same everywhere."""

import re
import shlex

import numpy as np
import pytest
from documents import ROOT, code_blocks, run_blocks
from processes import run

from app import __version__
from app.reference import Sphere


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_first_problem_is_hertz_s(page):
    [block] = code_blocks(text_of(page))
    names = run_blocks([block])
    exact = Sphere.from_load(10, 210e3 / (2 * 0.91), 100)
    assert names["solution"].converged
    assert names["solution"].max_pressure == pytest.approx(exact.max_pressure, rel=2e-3)
    assert names["solution"].contact_area == pytest.approx(exact.contact_area, rel=1e-2)


def test_first_command(tmp_path):
    solve, _ = code_blocks(text_of("docs/index.md"), "sh")[0].replace("\\\n", " ").splitlines()
    done = run(*shlex.split(solve)[1:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "ball.h5").is_file()


def test_python_of_the_guide(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    x = np.linspace(0, 1, 64)
    np.save("gap.npy", (x - 0.5) ** 2 + 0.3 * (x[:48, None] - 0.4) ** 2 + 1e-4 * np.cos(60 * x))
    blocks = code_blocks(text_of("docs/python.md"))
    names = run_blocks(blocks[:1])
    assert names["solution"].converged
    assert names["solution"].load == pytest.approx(82003.9, rel=1e-4)  # Hertz's
    names = run_blocks(blocks[1:], names)
    assert names["solution"].converged and names["solution"].load == pytest.approx(1000)
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 11
    assert names["result"].attributes["load"] == pytest.approx(100)
    assert names["again"].cycles == 3 and names["again"].extra["wear"].max() > 1e-4
    assert names["surface"].missing_points < 100  # few points of a random surface stand out
    assert len(capsys.readouterr().out.splitlines()) >= 12


def test_python_of_load_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [block] = code_blocks(text_of("docs/load-paths.md"))
    assert run_blocks([block])["exponent"] == pytest.approx(1.5, abs=0.01)


def test_version_is_the_same_everywhere():
    places = {
        "pyproject.toml": r'^version = "(.*?)"$',
        "CITATION.cff": r"^version: (.*?)$",
        "CHANGELOG.md": r"^## (\S+)",
    }
    found = {name: re.search(pattern, text_of(name), re.MULTILINE)[1] for name, pattern in places.items()}
    assert found == dict.fromkeys(places, __version__)
