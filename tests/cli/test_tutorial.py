"""docs/tutorial.md: its Python and its commands work, one after the other, in one folder."""

import re
import shlex
from importlib import import_module
from importlib.util import find_spec

import pytest
from documents import run_blocks
from processes import TESTS, run

TEXT = (TESTS.parent / "docs" / "tutorial.md").read_text(encoding="utf-8")
PAGE = (TESTS.parent / "docs" / "options.md").read_text(encoding="utf-8")
OUTPUTS = ("-o", "-output")


def can_run(command, missing):
    """Whether there is such a command with such options, and nobody was to write its input who could not."""
    module, words = command[1], command[2:]
    options = [word[1:] for word in words if re.match(r"-[a-z]\w+$", word)]
    there = find_spec(module) is not None and all(re.search(rf"-{option}\b", PAGE) for option in options)
    return there and not missing & set(words)


def test_tutorial(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names, missing, ran = {"__name__": "document"}, set(), []
    for language, block in re.findall(r"^```(python|sh|yaml)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL):
        if language == "yaml":
            (tmp_path / re.search(r"# (\w+\.yml)", block)[1]).write_text(block)
            continue
        if language == "python":
            run_blocks([block], names)
            continue
        for line in block.replace("\\\n", " ").splitlines():
            command = shlex.split(line)[1:]
            if not can_run(command, missing):
                missing |= {command[k + 1] for k, word in enumerate(command) if word in OUTPUTS}
                continue
            ran.append(command[1])
            if command[1] == "app.solve":
                done = run(*command, cwd=tmp_path)
                assert done.returncode == 0, (line, done.stderr)
            else:  # here, where everything is imported already
                coarse = ["--dpi", "20"] if command[1] == "app.plot" else []  # takes a third of the time
                assert import_module(command[1]).main([*command[2:], *coarse]) == 0, line
    assert {"app.solve", "app.report", "app.subsurface", "app.xdmf"} <= set(ran)
    assert names["solution"].converged
    exact, hottest = names["exact"], names["hottest"]
    assert names["bearing"].attributes["max_pressure"] == pytest.approx(exact.max_pressure, rel=5e-3)
    assert hottest.von_mises == pytest.approx(0.56 * exact.max_pressure, rel=0.02)
    assert hottest.depth == pytest.approx(0.70 * exact.a, rel=0.05)
    assert (tmp_path / "bearing.html").stat().st_size > 1e5
    assert (tmp_path / "bearing" / "subsurface.h5").is_file()
    assert "rms slope" in capsys.readouterr().out
