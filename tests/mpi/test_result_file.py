"""Result files on several ranks: ``mpiexec -n 3 python tests/mpi_result_file.py FOLDER``.

Also holds the made-up result that the serial tests write and draw.
"""

import resource
import sys
from contextlib import contextmanager, nullcontext
from pathlib import Path
from unittest import mock

import numpy as np
from mpi4py import MPI
from scipy.signal import fftconvolve

from app.halfspace.grid import Grid, Slabs
from app.output.result import ATTRIBUTES, FIELDS, Result, read_result, write_result

SEMI_AXES = 6.0019966, 3.9992013  # mm, of the ellipse of the paper's Hertz contact (Sec. 5.1)
MAX_PRESSURE = 1631.1995  # N/mm2


def hertz_pressure(x, y):
    """Semi-ellipsoid of Sec. 5.1, [N/mm2]."""
    a, b = SEMI_AXES
    return MAX_PRESSURE * np.sqrt(np.maximum(0.0, 1 - (x / a) ** 2 - (y / b) ** 2))


def made_up_result(nx=128, ny=96, punch_radius=None):
    """Exact Hertz pressure with displacements to match, and a plausible nested iteration.

    With `punch_radius`, cells outside that circle are inadmissible.
    """
    grid = Grid.from_domain(nx, ny, (-10.0, 10.0, -6.0, 6.0))
    x, y = grid.x(), grid.y()
    rho = np.hypot(*np.meshgrid(grid.dx * np.arange(1 - nx, nx), grid.dy * np.arange(1 - ny, ny)))
    rho[ny - 1, nx - 1] = grid.cell_area**0.5 / 3.5  # mean of 1/rho over a square cell: 4 ln(1 + 2^.5) / side
    pressure = hertz_pressure(x[None, :], y[:, None])
    displacement = 0.72 / (np.pi * 82000.0) * grid.cell_area * fftconvolve(pressure, 1 / rho, mode="same")
    shape = x[None, :] ** 2 / 600 + y[:, None] ** 2 / 326
    if punch_radius is not None:
        outside = np.hypot(x[None, :], y[:, None]) > punch_radius
        pressure[outside] = 0.0
        shape[outside] = np.nan
    gap = np.where(pressure > 0, 0.0, np.maximum(0.0, shape - 0.1091 + displacement))
    contact = (pressure > 0).astype(np.uint8)
    levels = [0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3]
    steps = [levels[: k + 1].count(l) for k, l in enumerate(levels)]
    history = {
        "level": np.array(levels),
        "contact_cells": np.array(
            [int(contact.sum() / 4 ** (3 - l) + 9 - 2 * s) for l, s in zip(levels, steps, strict=True)]
        ),
        "changed_cells": np.array([max(0, 9 * 2**l // 4**s) for l, s in zip(levels, steps, strict=True)]),
        "residual": np.array([2e-2 * 0.16**s for s in steps]),
        "inner_iterations": np.ones(len(levels), int),
        "work_units": np.cumsum([3 / 4.0 ** (3 - l) for l in levels]),
    }
    attributes = dict.fromkeys(ATTRIBUTES, 0) | {
        "converged": True,
        "reason": "contact set unchanged and residual below 1e-06",
        "active_set_iterations": 6,
        "work_units": 24.5,
        "residual": float(history["residual"][-1]),
        "load": float(grid.cell_area * pressure.sum()),
        "approach": 0.1091,
        "max_pressure": float(pressure.max()),
        "contact_cells": int(contact.sum()),
        "contact_fraction": float(contact.sum() / np.isfinite(shape).sum()),
        "solve_seconds": 0.1 + 0.2,
        "options": "-problem hertz\n" + "-x δ≤1 " * 20000,  # more than the 64 kB an attribute itself may have
        "command_line": "python -m app.solve",
        "version": "0.1.0",
        "lcp_rtol": 1e-6,
        "problem": "hertz",
        "hertz_rx": 300.0,
        "hertz_ry": 163.0,
        "shear_modulus": 82000.0,
        "poisson_ratio": 0.28,
        "domain": np.array([-10.0, 10.0, -6.0, 6.0]),
    }
    fields = pressure, gap, displacement, shape - 0.1091, contact
    return Result(*fields, x=x, y=y, attributes=attributes, history=history)


def write(path, comm, slabs, result, **changed):
    """Write `result`, each rank its own rows; `changed` replaces arguments of write_result."""
    arguments = {
        "fields": {name: getattr(result, name)[slabs.rows] for name in FIELDS},
        "x": result.x,
        "y": result.y,
        "attributes": result.attributes,
        "history": result.history,
    }
    write_result(path, comm, slabs, **(arguments | changed))


def assert_same(one, other):
    """Every number of two results is the same, bit by bit."""
    for name in (*FIELDS, "x", "y"):
        a, b = getattr(one, name), getattr(other, name)
        assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes(), name
    for a, b in ((one.history, other.history), (one.extra, other.extra)):
        assert a.keys() == b.keys()
        for name in a:
            assert a[name].dtype == b[name].dtype and a[name].tobytes() == b[name].tobytes(), name
    assert one.attributes.keys() == other.attributes.keys()
    for name, value in one.attributes.items():
        assert type(value) is type(other.attributes[name]), name
        assert np.array_equal(value, other.attributes[name]), name


def raised_everywhere(comm, kind, call):
    """Whether `call` raises `kind` on each rank; any other error is passed on."""
    try:
        call()
    except kind as error:
        return comm.allgather(str(error))
    raise AssertionError(f"rank {comm.rank}: no {kind.__name__}")


@contextmanager
def full_disk():
    """Let no file of this process grow beyond 4 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def unseen_folder():
    """Let this process open no file, as if the folder were on another machine's disk."""
    return mock.patch.object(Path, "open", side_effect=FileNotFoundError(2, "No such file or directory"))


def main(folder):
    comm = MPI.COMM_WORLD
    last = comm.size - 1
    result = made_up_result(64, 48, punch_radius=4.5)
    path = folder / "result.h5"

    for block in (1, 16, 48):  # 48: all rows on rank 0, none on the others
        slabs = Slabs(48, comm.size, comm.rank, block)
        extra = {name: getattr(result, name)[slabs.rows] for name in FIELDS} | {
            "rank": np.full((slabs.local, 64), comm.rank, np.int32)
        }
        late = result.attributes | {"solve_seconds": 0.3 + comm.rank}  # differs from rank to rank
        write(path, comm, slabs, result, fields=extra, attributes=late)
        found = read_result(path)
        assert (found.extra.pop("rank") == np.repeat(np.arange(comm.size), slabs.counts)[:, None]).all()
        assert found.attributes["solve_seconds"] == 0.3
        found.attributes["solve_seconds"] = result.attributes["solve_seconds"]
        assert_same(found, result)
        comm.Barrier()  # before the next write replaces what a slower rank still reads

    slabs = Slabs(48, comm.size, comm.rank)
    write(path, comm, slabs, result)
    before = path.read_bytes()
    comm.Barrier()
    wrong = {name: getattr(result, name)[slabs.rows] for name in FIELDS}
    if comm.rank == last:
        wrong["gap"] = wrong["gap"][:, :-1]
    said = raised_everywhere(comm, ValueError, lambda: write(path, comm, slabs, result, fields=wrong))
    assert len(set(said)) == 1 and f"rank {last}: field gap" in said[0], said

    for trouble, rank in ((full_disk, last), (full_disk, 0), (unseen_folder, last)):
        with trouble() if comm.rank == rank else nullcontext():
            said = raised_everywhere(comm, OSError, lambda: write(path, comm, slabs, result))
        assert len(set(said)) == 1 and f"rank {rank}: " in said[0], said
        assert [f.name for f in folder.iterdir()] == ["result.h5"]
        assert path.read_bytes() == before
        comm.Barrier()
    if comm.rank == 0:
        print(f"passed on {comm.size} ranks")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
