"""What README.md shows is run; what it says of options is what there is."""

import re

import numpy as np
import pytest
from documents import code_blocks, run_blocks
from processes import TESTS

from app import __version__
from app.commands.problem_options import PROBLEM_OPTIONS
from app.method import METHOD_OPTIONS, method_file
from app.options import REQUIRED

README = (TESTS.parent / "README.md").read_text(encoding="utf-8")
NO_LONGER = {"lcp_foresight", "lcp_merge", "lcp_cheap"}


def test_python_of_the_readme(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    x = np.linspace(0, 1, 64)
    np.save("gap.npy", (x - 0.5) ** 2 + 0.3 * (x[:48, None] - 0.4) ** 2 + 1e-4 * np.cos(60 * x))
    blocks = code_blocks(README)
    assert len(blocks) == 5
    names = run_blocks(blocks[:1])
    assert names["solution"].converged
    assert names["solution"].load == pytest.approx(82003.9, rel=1e-4)  # Hertz's
    names = run_blocks(blocks[1:], names)
    assert names["solution"].converged and names["solution"].load == pytest.approx(1000)
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 11
    assert names["result"].attributes["load"] == pytest.approx(100)
    assert len(capsys.readouterr().out.splitlines()) >= 12


def test_python_of_load_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [block] = code_blocks((TESTS.parent / "docs/load-paths.md").read_text(encoding="utf-8"))
    assert run_blocks([block])["exponent"] == pytest.approx(1.5, abs=0.01)


def table_of_options():
    """Name of an option -> the default that the README tells."""
    section = README[README.index("## Options") :]
    rows = re.findall(r"^\| (`-.*?) \|(.*?)\| .* \|$", section.replace(r"\|", "/"), re.MULTILINE)
    found = {}
    for names, default in rows:
        for name, text in zip(
            re.findall(r"`-(\w+)", names), [*default.strip().split(", "), *[""] * 9], strict=False
        ):
            found[name] = text
    return found


@pytest.mark.parametrize("option", [*METHOD_OPTIONS, *PROBLEM_OPTIONS], ids=lambda option: option.name)
def test_readme_has_every_option_and_its_default(option):
    told = table_of_options()[option.name]
    if option.name.startswith(("lcp_", "surface_")):
        default = option.default
        if default is None or default is REQUIRED:
            return
        if isinstance(default, str | bool):
            assert told == {False: "off"}.get(default, default)
        else:
            assert np.array_equal(np.array(told.split(","), float), np.atleast_1d(np.array(default, float)))


def test_readme_has_no_other_options():
    known = {option.name for option in METHOD_OPTIONS + PROBLEM_OPTIONS} | NO_LONGER
    assert not set(re.findall(r"-(lcp_\w+)", README)) - known


def test_readme_names_every_method_file():
    there = {path.stem for path in method_file("fast").parent.glob("*.opts")}
    assert there == set(re.findall(r"`(\w+)\.opts`", README))


def test_version_is_the_same_everywhere():
    root = TESTS.parent
    places = {
        "pyproject.toml": r'^version = "(.*?)"$',
        "CITATION.cff": r"^version: (.*?)$",
        "CHANGELOG.md": r"^## (\S+)",
    }
    found = {
        name: re.search(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)[1]
        for name, pattern in places.items()
    }
    assert found == dict.fromkeys(places, __version__)
