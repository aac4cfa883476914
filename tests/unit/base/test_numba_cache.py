"""The cache of compiled loops."""

import fcntl
import importlib
import pickle
import sys

import numba
import numpy as np
import pytest
from numba.core import event
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

LITERALS = """
from app.base.numba_cache import njit

@njit()
def power(x, n):
    result = 1.0
    for _ in range(n):
        result *= x
    return result

@njit()
def powers(x, n):
    return power(x, 1) + power(x, 2) + power(x, n)
"""

SIGNATURES = """
import gc
from collections import Counter

from numba.core import types
from numba.core.dispatcher import Dispatcher

from app import ContactProblem, Grid, Material, Paraboloid, solve

def number(kind):
    return kind.copy(readonly=False, layout="C") if isinstance(kind, types.Array) else kind

grid, material = Grid.from_domain(64, 64, (-1, 1, -1, 1)), Material.from_contact_modulus(1e5)
for periodic in (False, True):
    solve(ContactProblem(grid, material, Paraboloid(9, 7), periodic=periodic), load=5000)
found = 0
for loop in gc.get_objects():
    if isinstance(loop, Dispatcher) and loop.py_func.__module__.startswith("app."):
        kinds = Counter(tuple(map(number, args)) for args in loop.overloads)
        for kind, count in kinds.items():
            if count > 1:
                found += 1
                print(loop.py_func.__module__, loop.py_func.__name__, *loop.overloads, sep="\\n  ")
print(found)
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


def test_a_cached_loop_makes_arrays_in_a_process_that_compiles_and_imports_nothing(tmp_path):
    (tmp_path / "loops_of_a_test.py").write_text(ARRAYS)
    program = (
        "import sys, loops_of_a_test as loops\n"
        "before = len(sys.modules)\n"
        "print(loops.total(5), len(sys.modules) > before, *loops.total.stats.cache_hits.values())\n"
    )
    for expected in (["10.0", "True"], ["10.0", "False", "1"]):
        done = run("-c", program, env={"PYTHONPATH": f"{tmp_path}:{TESTS.parent}"})
        assert done.stdout.split() == expected


def test_the_cache_has_code_to_link_only_of_loops_that_others_call(tmp_path, monkeypatch):
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert (loops.twice(1.5), loops.four_times(1.5)) == (3, 6)
    linked = {}
    for file in (tmp_path / "__pycache__").glob("*.nbc"):
        (_, _, (_, bitcode)), *_ = pickle.loads(file.read_bytes())
        linked[file.name.split("-")[0]] = bitcode is not None
    assert linked == {
        "loops_of_a_test.twice": False,
        "loops_of_a_test.four_times": False,
        "loops_of_a_test.twice_inner": True,
    }


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


def test_literals_in_calls_compile_no_loop_again(tmp_path, monkeypatch):
    loops = import_loops(tmp_path, LITERALS, monkeypatch)
    with event.install_listener("numba:compile", event.RecordingListener()) as listener:
        assert loops.powers(3.0, 2) == 3 + 9 + 9
    compiled = [e.data["dispatcher"].py_func.__name__ for _, e in listener.buffer if e.is_start]
    assert sorted(compiled) == ["power_inner", "powers"]


def test_a_read_only_array_has_the_compiled_type_of_others():
    array = np.arange(6.0).reshape(2, 3)
    array.flags.writeable = False
    same = numba_cache.as_writable(array)
    assert numba.typeof(same) == numba.typeof(array.copy())
    assert np.shares_memory(same, array) and (same == array).all()


def test_solves_compile_no_loop_twice_for_equal_numbers():
    """A second signature may differ in types of numbers, not in layout or in read-only arrays."""
    done = run("-W", "ignore", "-c", SIGNATURES)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "0", done.stdout


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "cut", "noise", "flipped", "swapped", "folder"])
def test_a_damaged_cache_is_compiled_again(tmp_path, monkeypatch, suffix, damage):
    """Also if a file is a whole one of another loop."""
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert (loops.twice(1.5), loops.four_times(1.5)) == (3, 6)
    files = sorted((tmp_path / "__pycache__").glob(f"*.{suffix}"))
    contents = [file.read_bytes() for file in files]
    for file, content, other in zip(files, contents, contents[1:] + contents[:1], strict=True):
        file.unlink()
        if damage == "folder":
            file.mkdir()
            continue
        middle = len(content) // 2
        flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        ways = {"empty": b"", "cut": content[:-9], "noise": bytes(range(256)) * 9, "flipped": flipped}
        file.write_bytes({**ways, "swapped": other}[damage])
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert (loops.twice(1.5), loops.four_times(1.5)) == (3, 6)
    assert not loops.twice.stats.cache_hits
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert loops.twice(1.5) == 3
    assert bool(loops.twice.stats.cache_hits) == (damage != "folder")


def test_the_cache_next_to_the_source_serves_a_user_who_cannot_write_there(tmp_path, monkeypatch):
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert loops.twice(1.5) == 3
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "of the user"))
    loops = import_loops(tmp_path, LOOPS, monkeypatch)
    assert (loops.twice(1.5), loops.four_times(1.5)) == (3, 6)
    assert sum(loops.twice.stats.cache_hits.values()) == 1
    saved = {file.name.split("-")[0] for file in tmp_path.glob("of the user/*/*.nbc")}
    assert saved == {"loops_of_a_test.four_times", "loops_of_a_test.twice_inner"}


def test_without_any_writable_folder_loops_are_compiled(tmp_path, monkeypatch):
    def fail(*_):
        raise FileNotFoundError("no usable temporary folder")

    monkeypatch.setattr(numba_cache, "_make_cache", fail)
    assert import_loops(tmp_path, LOOPS, monkeypatch).four_times(1.5) == 6


def test_the_clock_stands_still_during_compilation_which_is_reported_once(tmp_path, monkeypatch, capsys):
    loops, now = import_loops(tmp_path, LOOPS, monkeypatch), [0.0]
    monkeypatch.setattr(numba_cache, "_times", numba_cache._Times())
    monkeypatch.setattr(numba_cache, "on_first_compile", numba_cache.announce_compilation)
    monkeypatch.setattr(numba_cache.time, "perf_counter", lambda: now[0])
    compile_ = loops.four_times._compiler.compile

    def slow(*arguments):
        now[0] += 40
        return compile_(*arguments)

    monkeypatch.setattr(loops.four_times._compiler, "compile", slow)
    before = numba_cache.clock()
    assert loops.four_times(1.5) == 6
    assert (now[0], numba_cache.clock(), numba_cache.compile_seconds()) == (40, before, 40)
    for _ in range(2):
        numba_cache.report_compilation()
    assert capsys.readouterr().err.splitlines() == [
        "note: compiling loops, once; this may take a minute", "note: compiling, once: 40 s",
    ]  # fmt: skip
    now[0] += 2
    assert numba_cache.clock() == before + 2
