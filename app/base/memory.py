"""Memory of hosts and processes, checked before allocation.

The constants are measured peaks of resident memory in set-up and solve, in numbers of 8 bytes (doubles) per cell of the
target grid. They include the coarser grids and the solution; see docs/notebook/scaling.md. Ranks of one host share its
memory.
"""

import ctypes
import os
import resource
from contextlib import suppress
from pathlib import Path

from app.base.errors import InputError, call_collectively, format_distinct

# per cell, on one rank
DOUBLES = {"fast": 10, "primal": 11, "active_set": 15, "film": 34, "snesvi": 37}
LISTS = 2.5  # with dilute contact, on lists of cells, without the arrays of the problem
PERIODIC_LISTS = 2.5  # more doubles with dilute contact on periodic patches, for all influence coefficients
WHOLE_SHAPE = 2  # more doubles with dilute contact, if the shape is not evaluated by rows
DOUBLE_PRECISION = 2  # more doubles of the default methods without single precision
CYCLES = 12  # more doubles of the active set with Gauss-Seidel, multigrid, or the search on periodic patches
HARDNESS = 3  # more doubles with a hardness
LAYER = 2  # more doubles with a coating or layer
COMPLIANCE = 5  # more doubles with a surface compliance of each cell
STRIP_DOUBLES = 64  # per cell of each of up to 4 rows and columns, for transforms
EXCHANGE = 0.2  # share more on several ranks, for receive buffers
MIN_DOUBLES = 9  # per cell, of any method on any problem
# Bytes of address space that a command needs to load its libraries and for a small solve, and for the solve alone.
# OpenBLAS retries a failed allocation forever, so a process with less is refused.
LOADING, SOLVING = 384 << 20, 192 << 20
MIN_CHECKED = 1 << 20  # bytes; smaller requests are not checked


def set_malloc_option(option, value):
    """Set an option of glibc's malloc, by its number in mallopt."""
    with suppress(AttributeError, ValueError):
        ctypes.CDLL(None).mallopt(option, value)


def doubles_per_cell(settings, periodic=False, capped=False, layered=False, compliant=False):
    """Return a method's peak memory in doubles per cell.

    Parameters
    ----------
    settings : app.options.method.Settings
        Options of the method.
    periodic : bool or str
        As the attribute of `Grid`: true for a periodic patch.
    capped : bool
        Whether the problem has a hardness.
    layered : bool
        Whether a body has a coating or layer.
    compliant : bool
        Whether each cell has a surface compliance of its own.
    """
    doubles = DOUBLES[settings.type] + HARDNESS * capped + LAYER * layered + COMPLIANCE * compliant
    if settings.type in ("fast", "primal"):
        return doubles + DOUBLE_PRECISION * (not settings.single)
    if settings.type != "active_set":
        return doubles
    of_pc = "pc_type", "pc_python_type"
    types = {text.rpartition(".")[2] for name, text in settings.texts.items() if name.endswith(of_pc)}
    return doubles + CYCLES * bool(periodic or types & {"mg", "ContactMG", "sor", "eisenstat"})


def doubles_in_strips(grid):
    """Return the number of doubles in FFT work arrays."""
    return STRIP_DOUBLES * sum(n * min(m, 4) for n, m in ((grid.nx, grid.ny), (grid.ny, grid.nx)))


def check_host_memory(comm, grid, doubles, what=""):
    """Raise InputError if a solve exceeds the memory.

    Collective. Each host needs memory for all of its ranks. Each process needs address space for its own data.

    Parameters
    ----------
    comm : app.parallel.communicator.Communicator
    grid : Grid
        Target grid, for the error message.
    doubles : float
        Number of doubles that this rank stores.
    what : str
        What needs them, for the error message.
    """
    from app.base.mpi import MPI

    needed = 8.0 * doubles * (1 + EXCHANGE * (comm.size > 1))
    host = comm.node
    together, ranks = host.allreduce(needed), host.size
    free = host.allreduce(available_memory(), MPI.MIN)

    def check():
        _check(grid, together, free, f"{what}on one host ({ranks} rank{'s'[: ranks > 1]})")
        _check(grid, needed + SOLVING, _address_space(), f"{what}in one process, which may have (ulimit -v)")

    call_collectively(comm, check)


def check_address_space():
    """Raise if ``ulimit -v`` leaves too little space for the solver's libraries."""
    free = _address_space()
    if free < LOADING:
        needed = f"needed: {_size(LOADING, free)} and what the grid takes"
        have = f"a process may take {_size(free, LOADING)} more of address space (ulimit -v)"
        raise InputError(f"{have}; {needed}")


def check_rank_memory(grid, cells):
    """Raise if this rank cannot store `cells` cells."""
    _check(grid, 8.0 * MIN_DOUBLES * cells, available_memory(), "on one host")


def _check(grid, needed, free, where):
    """Raise InputError if a grid exceeds the free bytes of a memory."""
    if needed > free:
        fit = f"about {format_distinct(int(grid.n * free / needed), grid.n, 2)} cells would fit"
        what = f"needs about {_size(needed, free)} {where}; {_size(free, needed)} are free"
        raise InputError(f"grid {grid.nx},{grid.ny}: {what}: {fit}")


def check_fits(size, what):
    """Raise InputError naming `what` unless `size` bytes are free."""
    if size < MIN_CHECKED:
        return
    free = min(available_memory(), _address_space())
    if size > free:
        raise InputError(f"{what}: needs {_size(size, free)} of memory; {_size(free, size)} are free")


def available_memory():
    """Return the bytes that this process can still allocate.

    The host and the control groups (containers) of the process limit this number. Pages that the kernel can drop count
    as free; swap does not count.
    """
    lines = _lines("/proc/meminfo")
    free = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    free = free or [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    return min(*free, *_free_in_control_groups())


# Version of control groups -> mount point, files of limit and use, and the entry of used pages that can be dropped.
_CONTROL_GROUPS = {
    "": ("sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    "memory": ("sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}  # fmt: skip


def _free_in_control_groups(root="/"):
    """Yield infinity, then the free bytes of each control group (container, job)."""
    yield float("inf")
    for line in _lines(f"{root}/proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers in _CONTROL_GROUPS:
            mount, limit, used, droppable = _CONTROL_GROUPS[controllers]
            top = Path(root, mount)
            group = Path(path.lstrip("/"))
            # In a container the files of the group itself lie at the top, at any path outside.
            for folder in {top / group, *(top / parent for parent in group.parents)}:
                try:
                    most, now = (int((folder / name).read_text()) for name in (limit, used))
                except (OSError, ValueError):  # no such file, or "max"
                    continue
                stat = dict(entry.split() for entry in _lines(folder / "memory.stat"))
                yield max(most - now + int(stat.get(droppable, 0)), 0)


def _address_space():
    """Return the bytes that ``ulimit -v`` still allows."""
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most == resource.RLIM_INFINITY:
        return float("inf")
    pages = int((_lines("/proc/self/statm") or ["0"])[0].split()[0])
    return max(most - pages * resource.getpagesize(), 0)


def _lines(path):
    try:
        return Path(path).read_text("utf-8", "replace").splitlines()
    except OSError:
        return []


def _size(size, other):
    """Format a number of bytes so that it differs from `other`."""
    unit, name = (2**30, "GiB") if size >= 2**29 else (2**20, "MiB")
    return f"{format_distinct(size / unit, other / unit)} {name}"
