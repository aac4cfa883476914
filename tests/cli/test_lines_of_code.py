"""docs/notebook/lines-of-code.md: its table counts the scripts of the page, and ours run."""

import re

import matplotlib.pyplot as plt
import pytest
from documents import run_blocks

from app.reference import Sphere
from benchmarks.lines_of_code import PACKAGES, PAGE, count_lines, read_scripts, write_inputs

TEXT = PAGE.read_text(encoding="utf-8")
TASKS = read_scripts(TEXT)
HERTZ = Sphere.from_load(10, 210e3 / (2 * 0.91), 100)
NUMBERS = {  # task -> first number that the script prints, and its tolerance
    "Ball under a load": (HERTZ.max_pressure, 1e-3),
    "Ball at an approach": (Sphere.from_approach(10, 210e3 / (2 * 0.91), 3e-3).load, 1e-3),
    "Save and read": (HERTZ.max_pressure, 1e-3),
    "Stress below the surface": (0.62 * HERTZ.max_pressure, 5e-3),
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return folder


def test_ten_tasks_take_at_most_the_lines_of_others():
    assert len(TASKS) == 10
    rows = re.findall(r"^\| (.*?) \| (\d+) \| (\d+|-) \| (\d+|-) \|$", TEXT, re.MULTILINE)
    counts = {
        task: tuple(str(count_lines(scripts[name])) if name in scripts else "-" for name in PACKAGES)
        for task, scripts in TASKS.items()
    }
    assert {task: tuple(numbers) for task, *numbers in rows} == counts
    for scripts in TASKS.values():
        lines = {name: count_lines(script) for name, script in scripts.items()}
        assert lines[PACKAGES[0]] == min(lines.values())


@pytest.mark.parametrize("task", TASKS)
def test_our_scripts_run(task, inputs, monkeypatch, capsys):
    monkeypatch.chdir(inputs)
    plt.switch_backend("agg")
    run_blocks([TASKS[task][PACKAGES[0]]])
    plt.close("all")
    printed = capsys.readouterr().out.split()
    if task in NUMBERS:
        number, tolerance = NUMBERS[task]
        assert float(printed[0]) == pytest.approx(number, rel=tolerance)
