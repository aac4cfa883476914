"""Compiled loops that were kept: loaded to be called, and still parts of others."""

import fcntl
import importlib
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from app import compiled

ROOT = Path(__file__).resolve().parents[2]

LOOPS = """
from app.compiled import njit

@njit()
def twice(x):
    return 2 * x

@njit()
def four_times(x):
    return twice(twice(x))
"""

SLICES = """
import numpy as np
from app.compiled import njit

@njit(makes_arrays=True)
def rows(a):
    b = np.zeros((2, a.shape[1]))
    b[1, 1:] = a[0, 1:]
    return b
"""

ROWS = """
from app.compiled import njit

@njit({})
def total(a, b):
    found = 0.0
    for j in range(len(a)):
        row = a[j] if j % 2 else b[j]
        for i in range(len(row)):
            found += row[i]
    return found
"""

ARRAYS = """
import numpy as np

from app.compiled import njit


@njit(makes_arrays=True)
def total(n):
    numbers = np.empty(n)
    for k in range(n):
        numbers[k] = k
    return numbers.sum()
"""


def test_a_loaded_loop_is_machine_code_until_another_is_made_of_it(tmp_path, monkeypatch):
    (tmp_path / "loops_of_a_test.py").write_text(LOOPS)
    monkeypatch.syspath_prepend(tmp_path)
    loops = importlib.import_module("loops_of_a_test")
    assert loops.four_times(1.5) == 6
    del sys.modules["loops_of_a_test"]
    loops = importlib.import_module("loops_of_a_test")
    assert loops.four_times(1.5) == 6
    assert loops.twice(1.5) == 3
    assert sum(loops.twice.stats.cache_hits.values()) == 1
    [code] = [overload.library for overload in loops.twice.overloads.values()]
    assert isinstance(code, compiled._Library)
    assert code._shared_module is None

    twice = loops.twice

    @numba.njit
    def one_more(x):
        return twice(x) + 1

    assert one_more(1.5) == 4
    assert code._shared_module is not None


@pytest.mark.parametrize("known", [True, False])
def test_a_loaded_loop_finds_memory_for_its_arrays(tmp_path, known):
    """In a process that compiles nothing; and what is loaded of a release of numba whose inside nobody knows."""
    (tmp_path / "loops_of_a_test.py").write_text(ARRAYS)
    program = (
        f"from app import compiled; compiled._KNOWN = {known}\n"
        "import loops_of_a_test as loops\n"
        "print(loops.total(5), *loops.total.stats.cache_hits.values())\n"
        "print(*{isinstance(found.library, compiled._Library) for found in loops.total.overloads.values()})"
    )
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join((str(tmp_path), str(ROOT))))
    for hits in ([], ["1"]):
        said = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert said.stdout.split() == ["10.0", *hits, str(known)]


def test_a_loaded_loop_brings_no_module_that_it_was_made_from(tmp_path):
    (tmp_path / "loops_of_a_test.py").write_text(SLICES)
    program = (
        "import sys, numpy as np, loops_of_a_test\n"
        "print(loops_of_a_test.rows(np.ones((2, 3))).sum(), 'numba.np.arrayobj' in sys.modules)"
    )
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join((str(tmp_path), str(ROOT))))
    for brought in (True, False):
        said = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert said.stdout.split() == ["2.0", str(brought)]


def test_loops_do_not_count_references_and_those_that_do_are_kept_apart(tmp_path, monkeypatch):
    """Though numba takes files of one size and time for the same."""
    monkeypatch.syspath_prepend(tmp_path)
    for how, counts, kept in (
        ("makes_arrays=True", True, False),
        ("", False, False),
        ("makes_arrays=True", True, True),
    ):
        (tmp_path / "loops_of_a_test.py").write_text(ROWS.format(f"{how:20}"))
        os.utime(tmp_path / "loops_of_a_test.py", (0, 0))
        for name in (tmp_path / "__pycache__").glob("*.pyc"):
            name.unlink()
        sys.modules.pop("loops_of_a_test", None)
        loops = importlib.import_module("loops_of_a_test")
        assert loops.total(np.ones((3, 4)), np.ones((3, 4))) == 12
        assert bool(loops.total.stats.cache_hits) == kept
        if not kept:
            [code] = loops.total.inspect_llvm().values()
            assert ("call void @NRT_decref" in code) == counts


def test_a_loop_that_makes_an_array_has_to_say_so(tmp_path, monkeypatch):
    (tmp_path / "loops_of_a_test.py").write_text(ARRAYS.replace("makes_arrays=True", ""))
    monkeypatch.syspath_prepend(tmp_path)
    sys.modules.pop("loops_of_a_test", None)
    with pytest.raises(
        numba.core.errors.NumbaError, match="NRT required|Only accept returning of array passed"
    ):
        importlib.import_module("loops_of_a_test").total(5)


def test_who_is_interrupted_while_compiling_lets_the_others_compile(tmp_path, monkeypatch):
    (tmp_path / "loops_of_a_test.py").write_text(LOOPS)
    monkeypatch.syspath_prepend(tmp_path)
    sys.modules.pop("loops_of_a_test", None)
    loops = importlib.import_module("loops_of_a_test")

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(loops.twice._compiler, "compile", interrupted)
        with pytest.raises(KeyboardInterrupt):
            loops.twice(1.5)
    [lock] = (tmp_path / "__pycache__").glob("*twice*.lock")
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert loops.twice(1.5) == 3
