"""Memory: estimates of solves, what a host has, refusal of what does not fit."""

import json
import resource

import h5py
import numpy as np
import pytest
from cases import hertz
from mpi4py import MPI
from processes import TESTS, run

from app import ContactSolver, Grid, InputError, read_surface
from app.base import memory
from app.methods.free import dilute
from app.parallel.communicator import Communicator
from app.problems.gap_file import GapFile

GRID = Grid(4000, 3000, 1.0, 1.0)

LONG = """
import sys
from pathlib import Path
import numpy as np
from mpi4py import MPI
from app import ContactProblem, ContactSolver, Grid, Material
from app.base import numba_cache
from app.base.memory import doubles_per_cell, doubles_in_strips
from app.options.method import make_settings
numba_cache.on_first_compile = lambda: print("compiling", file=sys.stderr)
def peak():  # getrusage includes the parent process
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024
def solve(nx, ny):
    grid = Grid.from_domain(nx, ny, (0, 1, 0, 1))
    gap = np.cos(np.arange(nx) * 20 / nx) + np.cos(np.arange(ny) * 20 / ny)[:, None]
    with ContactSolver(ContactProblem(grid, Material.combined(1, 0.3), gap)) as solver:
        solver.solve(approach=solver.touching + 0.01)
    return 8 * (grid.n * doubles_per_cell(make_settings()) + doubles_in_strips(grid))
solve(300, 3)
before = peak()
estimated = solve(*map(int, sys.argv[1:]))
print(peak() - before, estimated)
"""


def output(*command, **how):
    """Output of a command that measures memory, repeated as long as it has to compile loops."""
    for _ in range(5):
        done = run(*command, timeout=300, **how)
        assert done.returncode == 0, done.stderr
        if "compiling" not in done.stderr:
            break
    return done.stdout


def peak(*words, **how):
    """Doubles per cell, as measured and as estimated."""
    numbers = json.loads(output(TESTS / "peak.py", *words, **how))
    return numbers["measured"], numbers["estimated"]


@pytest.mark.parametrize(
    ("method", "pressure"),
    [
        ("default", 50),
        ("default", "ball:12000"),  # in a window of 0.7 of the cells
        pytest.param("default", 600, marks=pytest.mark.slow),  # 55% contact
        pytest.param("periodic:default", 50, marks=pytest.mark.slow),
    ],
)
def test_default_methods_need_ten_doubles_per_cell(method, pressure):
    measured, estimated = peak(1024, method, pressure)
    assert 0.5 * estimated < measured <= 10 <= estimated


@pytest.mark.parametrize("pressure", ["spots:1", "spots:0.02", pytest.param("0.02", marks=pytest.mark.slow)])
def test_dilute_contact_needs_two_doubles_per_cell(pressure):
    measured, estimated = peak(2048, "default", pressure)
    assert 0.5 * estimated < measured <= estimated < 5


@pytest.mark.slow
@pytest.mark.parametrize("method", ["default", "periodic:default"])
def test_estimate_includes_a_hardness(method):
    measured, estimated = peak(1024, method, 50, 500)
    assert 0.5 * estimated < measured <= estimated


@pytest.mark.slow
def test_ranks_of_one_host_share_its_memory():
    measured, estimated = peak(1024, "default", 50, ranks=2)
    assert measured < (1 + memory.EXCHANGE) * estimated


def test_estimated_memory_is_the_measured_peak():
    """docs/notebook/scaling.md promises a factor: at most a tenth more than estimated, and half of it at least."""
    measured, estimated = peak(256, "fmg_v11")
    assert 0.5 * estimated < measured < 1.1 * estimated


def test_a_grid_too_large_for_its_host_is_refused_before_allocation(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 2.0**30)
    with pytest.raises(
        InputError, match=r"grid 4096,4096: needs about 1.27 GiB on one host \(1 rank\); 1 GiB are free"
    ):
        ContactSolver(hertz(4096), options={"lcp_window": 0})  # no lists
    memory.check_host_memory(Communicator(MPI.COMM_SELF), GRID, 2**27)  # just fits
    with pytest.raises(InputError, match="about 1.199e\\+07 cells would fit"):
        memory.check_host_memory(Communicator(MPI.COMM_SELF), GRID, 1.001 * 2**27)
    monkeypatch.setattr(memory, "available_memory", lambda: 2.0**28)
    with pytest.raises(InputError, match=r"grid 4096,4096: needs about 320 MiB on one host \(1 rank\)"):
        ContactSolver(hertz(4096))


def test_contact_that_is_not_dilute_is_refused_if_all_cells_need_too_much_memory(monkeypatch):
    monkeypatch.setattr(dilute, "MIN_CELLS", 64)
    monkeypatch.setattr(dilute, "MAX_SHARE", 0.5)
    monkeypatch.setattr(memory, "available_memory", lambda: 200000.0)
    with pytest.raises(InputError, match="needs about .* on one host"):
        ContactSolver(hertz(64), options={"lcp_window": 0})
    with ContactSolver(hertz(64)) as solver:
        for name in ("MAX_COST", "MAX_GROWN_COST", "MAX_CHECK_COST"):
            monkeypatch.setattr(dilute, name, np.inf)
        first = solver.solve(load=1.0)
        for name in ("MAX_COST", "MAX_GROWN_COST", "MAX_CHECK_COST", "MAX_SHARE"):
            monkeypatch.setattr(dilute, name, 0.0)
        many = (
            r"grid 64,64: needs about .* MiB more for contact of many cells on one host \(1 rank\); .* free"
        )
        for start in (None, first):
            with pytest.raises(InputError, match=many):
                solver.solve(load=1.0, start=start)
        monkeypatch.setattr(memory, "available_memory", lambda: 2.0**30)
        assert solver.solve(load=1.0).max_pressure == pytest.approx(first.max_pressure, rel=1e-3)


def test_a_grid_too_large_for_the_limit_of_its_process_is_refused(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (2**40, 2**40))
    memory.check_host_memory(Communicator(MPI.COMM_SELF), GRID, 16000)
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (1000, 1000))
    with pytest.raises(InputError, match="ulimit -v"):
        memory.check_host_memory(Communicator(MPI.COMM_SELF), GRID, 16000)


def test_a_process_short_of_address_space_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "_address_space", lambda: 383 << 20)
    with pytest.raises(InputError, match="may take 383 MiB more of address space .*; needed: 384 MiB"):
        memory.check_address_space()


@pytest.mark.parametrize("shape", [(1, 100000), (20000, 20)])
def test_long_patches_need_the_estimated_memory(shape):
    """Transforms work on strips as long as the patch; of a narrow patch they are most of its memory."""
    measured, estimated = map(float, output("-c", LONG, *map(str, shape)).split())
    assert 0.3 * estimated < measured <= 1.1 * estimated + 24e6  # what is loaded late, and what malloc keeps


@pytest.mark.timeout(20)
@pytest.mark.parametrize("how", [{}, {"orient": "flip_y"}, {"crop": (0, 10**7, 1, 10**7)}])
def test_huge_heights_declared_by_a_small_file_are_refused_at_once(how, tmp_path):
    with h5py.File(tmp_path / "large.h5", "w") as file:
        heights = file.create_dataset(
            "heights", (10**7, 10**7), "i1", chunks=(1024, 1024), compression="gzip"
        )
        heights.attrs.update(unit="um", spacing=(1.0, 1.0))
    with pytest.raises(InputError, match=r"large\.h5.* needs .* of memory"):
        read_surface(tmp_path / "large.h5", **how)
    with pytest.raises(InputError, match=r"large\.h5.* needs .* of memory"):
        GapFile(tmp_path / "large.h5").rows()
    small = read_surface(tmp_path / "large.h5", crop=(5, 13, 0, 4))
    assert small.shape == (4, 8)


@pytest.mark.parametrize(
    ("line", "folder", "files"),
    [
        ("0::/slurm/job_7", "sys/fs/cgroup", ("memory.max", "memory.current", "inactive_file")),
        (
            "4:memory:/slurm/job_7",
            "sys/fs/cgroup/memory",
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
        ),
    ],
)
@pytest.mark.parametrize("inside", ["slurm/job_7", "slurm", ""])  # "": of a container
def test_control_groups_limit_memory(line, folder, files, inside, tmp_path):
    group, (limit, used, droppable) = tmp_path / folder / inside, files
    (tmp_path / "proc/self").mkdir(parents=True)
    (tmp_path / "proc/self/cgroup").write_text(f"11:cpu:/x\n{line}\n")
    group.mkdir(parents=True)
    (group / limit).write_text("1000\n")
    (group / used).write_text("700\n")
    (group / "memory.stat").write_text(f"anon 600\n{droppable} 50\n")
    assert list(memory._free_in_control_groups(tmp_path)) == [float("inf"), 350]
    (group / limit).write_text("max\n")
    assert list(memory._free_in_control_groups(tmp_path)) == [float("inf")]
