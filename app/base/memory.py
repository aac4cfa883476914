"""How much memory a host has to give, and whether something fits, before anything is allocated.

What a solve takes was measured: peak resident memory of set-up and solve in doubles per cell of the target grid,
coarser grids and the solution included, see docs/notebook/scaling.md. Ranks of one host share its memory.
"""

from __future__ import annotations

import ctypes
import os
import resource
from contextlib import suppress
from pathlib import Path

from app.base.errors import InputError, call_collectively, format_distinct

DOUBLES = {"fast": 10, "primal": 11, "active_set": 15, "tao": 37, "snesvi": 37}  # per cell, on one rank
DOUBLE_PRECISION = 2  # more of the first two, without single precision
CYCLES = 12  # more of the active set with Gauss-Seidel sweeps, multigrid cycles, or the root search of periodic patches
STRIPS = 64  # for each of up to 4 rows and columns, per cell of it: what transforms work on
EXCHANGE = 0.2  # share more on several ranks: what is received while columns and rows change places
LEAST = 9  # of any method on any problem
# Bytes of address space that libraries take from the start of a command to the end of a small solve, and those of the
# solve alone. OpenBLAS repeats for ever what it cannot allocate, so less is refused.
LOADING, SOLVING = 384 << 20, 192 << 20
SMALL = 1 << 20  # bytes that nobody asks after


def set_malloc_option(option, value):
    """Set an option of glibc's malloc, by mallopt's number; other C libraries have none. Not collective."""
    with suppress(AttributeError, ValueError):
        ctypes.CDLL(None).mallopt(option, value)


def doubles_per_cell(settings, periodic=False):
    """What a method takes at most per cell it holds, in doubles. Not collective.

    Parameters
    ----------
    settings : app.options.method.Settings
    periodic : bool or str
        Whether the patch is, see `Grid.periodic`.
    """
    doubles = DOUBLES[settings.strategy]
    if settings.strategy in ("fast", "primal"):
        return doubles + DOUBLE_PRECISION * (not settings.single)
    if settings.strategy != "active_set":
        return doubles
    of_pc = "pc_type", "pc_python_type"
    types = {text.rpartition(".")[2] for name, text in settings.texts.items() if name.endswith(of_pc)}
    return doubles + CYCLES * bool(periodic or types & {"mg", "ContactMG", "sor", "eisenstat"})


def doubles_in_strips(grid):
    """Count the doubles of the strips that a rank transforms at once. Not collective."""
    return STRIPS * sum(n * min(m, 4) for n, m in ((grid.nx, grid.ny), (grid.ny, grid.nx)))


def check_host_memory(comm, grid, doubles):
    """Refuse a grid that does not fit into the memory of a host, or of one process.

    Collective.

    Parameters
    ----------
    comm : app.parallel.communicator.Communicator
    grid : Grid
        For the message.
    doubles : float
        That this rank will hold.

    Raises
    ------
    InputError
        On all ranks, if there is too little memory for any.
    """
    from app.base.mpi import MPI

    needed = 8.0 * doubles * (1 + EXCHANGE * (comm.size > 1))
    host = comm.node
    together, ranks = host.allreduce(needed), host.size
    there = host.allreduce(available_memory(), MPI.MIN)

    def check():
        _check(grid, together, there, f"on one host ({ranks} rank{'s'[: ranks > 1]})")
        _check(grid, needed + SOLVING, _address_space(), "in one process, which may have (ulimit -v)")

    call_collectively(comm, check)


def check_address_space():
    """Refuse to start in a process that may not load what a solve needs. Not collective."""
    free = _address_space()
    if free < LOADING:
        raise InputError(
            f"a process may take {_size(free, LOADING)} more of address space (ulimit -v); "
            f"needed: {_size(LOADING, free)} and what the grid takes"
        )


def check_rank_memory(grid, cells):
    """Refuse a grid of whose cells this rank cannot hold its share by any method."""
    _check(grid, 8.0 * LEAST * cells, available_memory(), "on one host")


def _check(grid, needed, there, where):
    if needed > there:
        raise InputError(
            f"grid {grid.nx},{grid.ny}: needs about {_size(needed, there)} {where}; {_size(there, needed)} are free: "
            f"about {format_distinct(int(grid.n * there / needed), grid.n, 2)} cells would fit"
        )


def check_fits(size, what):
    """Refuse what is larger than the memory there is. Not collective.

    Parameters
    ----------
    size : float
        Bytes.
    what : str
        For the message.

    Raises
    ------
    InputError
    """
    if size < SMALL:
        return
    there = min(available_memory(), _address_space())
    if size > there:
        raise InputError(f"{what}: needs {_size(size, there)} of memory; {_size(there, size)} are free")


def available_memory():
    """Bytes that this process and others beside it may still take: of the host, or of its control groups.

    Not collective. Pages that the kernel can drop count as free; swap does not count.
    """
    return min(_of_the_host(), *_of_control_groups())


def _of_the_host():
    for line in _lines("/proc/meminfo"):
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


# Version of control groups: where they are mounted, files of limit and use, and which of the used pages can be dropped.
_GROUPS = {
    "": ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    "memory": (
        "/sys/fs/cgroup/memory",
        "memory.limit_in_bytes",
        "memory.usage_in_bytes",
        "total_inactive_file",
    ),
}


def _of_control_groups(root="/"):
    """What each control group that this process is in has left; `root` is another file system, for tests."""
    yield float("inf")
    for line in _lines(f"{root}/proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers in _GROUPS:
            mount, limit, used, droppable = _GROUPS[controllers]
            top = Path(f"{root}/{mount}")
            inside = Path(path.lstrip("/"))
            # In a container the group's own files lie at the top, whatever its path is outside.
            for group in {top / inside, *(top / parent for parent in inside.parents)}:
                try:
                    most, now = (int((group / name).read_text()) for name in (limit, used))
                except (OSError, ValueError):  # not here, or "max"
                    continue
                stat = dict(entry.split() for entry in _lines(group / "memory.stat"))
                yield max(most - now + int(stat.get(droppable, 0)), 0)


def _address_space():
    """Bytes of address space that this process may still take, by ``ulimit -v``."""
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return float("inf")
    pages = int(_lines("/proc/self/statm", ["0"])[0].split()[0])
    return max(most - pages * resource.getpagesize(), 0)


def _lines(path, otherwise=()):
    try:
        return Path(path).read_text().splitlines()
    except OSError:
        return otherwise


def _size(size, other):
    """Write a number of bytes so that it differs from another one."""
    unit, name = (2**30, "GiB") if size >= 2**29 else (2**20, "MiB")
    return f"{format_distinct(size / unit, other / unit)} {name}"
