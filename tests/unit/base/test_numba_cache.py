"""The cache of compiled loops."""

import fcntl
import importlib
import sys

import numba
import numpy as np
import pytest
from processes import TESTS, run

from app.base import numba_cache

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


def import_loops(folder, content, monkeypatch):
    """Import a module of loops that nothing has compiled yet, or cached ones again."""
    file = folder / "loops_of_a_test.py"
    if not file.exists():  # the cache depends on its time
        file.write_text(content)
    monkeypatch.syspath_prepend(folder)
    sys.modules.pop("loops_of_a_test", None)
    return importlib.import_module("loops_of_a_test")


def test_a_cached_loop_makes_arrays_in_a_process_that_compiles_nothing(tmp_path):
    (tmp_path / "loops_of_a_test.py").write_text(ARRAYS)
    program = (
        "import loops_of_a_test as loops\nprint(loops.total(5), *loops.total.stats.cache_hits.values())\n"
    )
    for hits in ([], ["1"]):
        done = run("-c", program, env={"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"})
        assert done.stdout.split() == ["10.0", *hits]


def test_a_cached_loop_can_be_called_by_another(tmp_path, monkeypatch):
    for _ in range(2):
        loops = import_loops(tmp_path, LOOPS, monkeypatch)
        assert loops.twice(1.5) == 3
    assert sum(loops.twice.stats.cache_hits.values()) == 1
    twice = loops.twice

    @numba.njit
    def one_more(x):
        return twice(x) + 1

    assert one_more(1.5) == 4


@pytest.mark.parametrize("how", ["", "makes_arrays=True"])
def test_only_loops_that_make_arrays_count_references(tmp_path, monkeypatch, how):
    loops = import_loops(tmp_path, ROWS.format(how), monkeypatch)
    assert loops.total(np.ones((3, 4)), np.ones((3, 4))) == 12
    [code] = loops.total.inspect_llvm().values()
    assert ("call void @NRT_decref" in code) == bool(how)


def test_the_first_compilation_is_announced_once_even_if_it_cannot_be_cached(tmp_path, monkeypatch):
    loops, announced = import_loops(tmp_path, LOOPS, monkeypatch), []
    monkeypatch.setattr(numba_cache, "on_first_compile", lambda: announced.append(1))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(numba_cache.FunctionCache, "save_overload", full)
    assert loops.four_times(1.5) == 6
    assert announced == [1]


def test_an_undeclared_array_is_an_error_of_the_compiler(tmp_path, monkeypatch):
    loops = import_loops(tmp_path, ARRAYS.replace("makes_arrays=True", ""), monkeypatch)
    with pytest.raises(
        numba.core.errors.NumbaError, match="NRT required|Only accept returning of array passed"
    ):
        loops.total(5)


def test_an_interrupted_compilation_releases_its_lock(tmp_path, monkeypatch):
    loops = import_loops(tmp_path, LOOPS, monkeypatch)

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
