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

from app.base import numba_cache

ROOT = Path(__file__).resolve().parents[2]

LOOPS = """
from app.base.numba_cache import njit

@njit()
def twice(x):
    return 2 * x

@njit()
def four_times(x):
    return twice(twice(x))
"""

ROWS = """
from app.base.numba_cache import njit

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

from app.base.numba_cache import njit


@njit(makes_arrays=True)
def total(n):
    numbers = np.empty(n)
    for k in range(n):
        numbers[k] = k
    return numbers.sum()
"""


def test_a_loaded_loop_finds_memory_for_its_arrays(tmp_path):
    """In a process that compiles nothing."""
    (tmp_path / "loops_of_a_test.py").write_text(ARRAYS)
    program = (
        "import loops_of_a_test as loops\nprint(loops.total(5), *loops.total.stats.cache_hits.values())\n"
    )
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join((str(tmp_path), str(ROOT))))
    for hits in ([], ["1"]):
        said = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert said.stdout.split() == ["10.0", *hits]


def test_a_loaded_loop_is_part_of_another(tmp_path, monkeypatch):
    (tmp_path / "loops_of_a_test.py").write_text(LOOPS)
    monkeypatch.syspath_prepend(tmp_path)
    for _ in range(2):
        sys.modules.pop("loops_of_a_test", None)
        loops = importlib.import_module("loops_of_a_test")
        assert loops.twice(1.5) == 3
    assert sum(loops.twice.stats.cache_hits.values()) == 1
    twice = loops.twice

    @numba.njit
    def one_more(x):
        return twice(x) + 1

    assert one_more(1.5) == 4


@pytest.mark.parametrize("how", ["", "makes_arrays=True"])
def test_only_loops_that_make_arrays_count_references(tmp_path, monkeypatch, how):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "loops_of_a_test.py").write_text(ROWS.format(how))
    sys.modules.pop("loops_of_a_test", None)
    loops = importlib.import_module("loops_of_a_test")
    assert loops.total(np.ones((3, 4)), np.ones((3, 4))) == 12
    [code] = loops.total.inspect_llvm().values()
    assert ("call void @NRT_decref" in code) == bool(how)


def test_compiling_is_told_once_and_a_loop_that_cannot_be_kept_works(tmp_path, monkeypatch):
    (tmp_path / "loops_of_a_test.py").write_text(LOOPS)
    monkeypatch.syspath_prepend(tmp_path)
    sys.modules.pop("loops_of_a_test", None)
    loops, told = importlib.import_module("loops_of_a_test"), []
    monkeypatch.setattr(numba_cache, "on_first_compile", lambda: told.append(1))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(numba_cache.FunctionCache, "save_overload", full)
    assert loops.four_times(1.5) == 6
    assert told == [1]


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
