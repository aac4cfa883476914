"""A made-up result, for tests of what is written and drawn."""

import resource
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from scipy.signal import fftconvolve

from app.halfspace.grid import Grid
from app.io.result import ATTRIBUTES, FIELDS, Result
from app.io.write import write_result

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
    contact = pressure > 0
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
        "contact_modulus": 82000.0 / 0.72,
        "analytic_approach": 0.1091,
        "domain": [-10.0, 10.0, -6.0, 6.0],
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


@contextmanager
def full_disk(size=4096):
    """Let no file of this process grow beyond some bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def with_attributes(result, without=(), **changed):
    values = {k: v for k, v in (result.attributes | changed).items() if k not in without}
    return replace(result, attributes=values)
