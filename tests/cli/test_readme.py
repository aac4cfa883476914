"""What README.md and pages of docs/ show is run; the version is the same everywhere."""

import re

import numpy as np
import pytest
from documents import ROOT, code_blocks, commands, run_blocks

from app import __version__
from app.cli import subsurface
from app.reference import EllipticHertz, Sphere


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


SHOWN = [f"docs/{name}.md" for name in "index commands load-paths surfaces periodic command-line".split()]


@pytest.mark.parametrize("page", ["README.md", *SHOWN])
def test_solves_that_a_page_shows(page, tmp_path, cli_here):
    (tmp_path / "results").mkdir()
    (tmp_path / "petsc_options").symlink_to(ROOT / "petsc_options")
    np.save(tmp_path / "gap.npy", np.hypot(*np.mgrid[-1:1:48j, -1:1:48j]) ** 2 / 10)
    np.save(tmp_path / "heights.npy", np.random.default_rng(1).random((48, 50)))
    shown = [words for words in commands(text_of(page)) if words[0] == "app.solve"]
    assert shown
    for _, *words in shown:
        small = ["-grid", "64"] * any("fmg_v11" in word for word in words)  # seconds, on the page's grid
        done = cli_here(*words, *small, cwd=tmp_path)
        assert done.returncode == 0, (words, done.stderr)


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
    exact = EllipticHertz.from_load(460, 200, names["steel"].contact_modulus, 80e3)
    assert names["depth"] == pytest.approx(exact.approach, rel=2e-3)
    assert names["semi_axes"] == pytest.approx((exact.a, exact.b), rel=2e-2)
    assert names["again"].cycles == 3 and names["again"].extra["wear"].max() > 1e-4
    np.testing.assert_allclose(names["worn"], names["gap"] + names["again"].extra["wear"], rtol=1e-12)
    assert names["surface"].missing_points < 100  # few points of a random surface stand out
    assert len(capsys.readouterr().out.splitlines()) >= 12
    text = text_of("docs/results.md")  # goes on with the guide's file
    run_blocks(code_blocks(text))
    assert np.loadtxt("cells.txt").shape == (names["gap"].size, 4)
    [[_, *words]] = commands(text)
    assert subsurface.main(words) == 0


def test_python_of_load_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_blocks(code_blocks(text_of("docs/load-paths.md")))
    assert names["exponent"] == pytest.approx(1.5, abs=0.01)
    assert names["areas"] == list(names["path"].table["contact_area"])
    assert Sphere.from_load(20, 80000 / 0.7, names["load"]).contact_area == pytest.approx(0.5, rel=3e-2)


def test_version_is_the_same_everywhere():
    places = {
        "pyproject.toml": r'^version = "(.*?)"$',
        "CITATION.cff": r"^version: (.*?)$",
        "CHANGELOG.md": r"^## (\d\S+)",
    }
    found = {name: re.search(pattern, text_of(name), re.MULTILINE)[1] for name, pattern in places.items()}
    assert found == dict.fromkeys(places, __version__)


def test_python_of_the_page_on_layers():
    names = run_blocks(code_blocks(text_of("docs/layers.md")))
    on_coating, on_substrate = names["on_coating"], names["on_substrate"]
    assert abs(on_coating - on_substrate)[0].max() > 100 * abs(on_coating - on_substrate)[2].max()
    assert names["maxima"].coating.von_mises > 0
