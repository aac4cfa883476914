"""Periodic self-affine surfaces under mean pressures: the page of `run/bench --periodic`."""

import itertools
import tempfile
from pathlib import Path

import numpy as np
from tqdm import tqdm

from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.io.table import format_markdown
from app.problems.random_surfaces import SelfAffineSurface
from benchmarks.measure import Memory, head, insist, note_on, publish, quickest, solve_command
from benchmarks.plain import PlainPeriodicProduct, check_periodic

SIDE, SLOPE = 1.0, 0.1  # of the patch [mm], rms
MATERIAL = Material.combined(80000.0, 0.3)
# Mean pressure / (E* rms slope): contact on 2, 11, 53, 97 and 100% of the cells.
LOADS = (0.01, 0.05, 0.3, 1.0, 3.0)

PAGE = """\
The self-affine surface has a period of 1 mm, Hurst exponent 0.8, roll-off 1/8, a cut-off of 8 cells and rms slope 0.1.
The mean pressure is prescribed. Times are ratios to one *plain product*: `scipy.fft.rfft2`, multiplication by the
symbol, `irfft2`, without padding, one thread, measured in the same run (shortest of several).

- `load`: mean pressure over E* times the rms slope.
- `plain`: time of the first solve of a process without set-up, in plain products.
- `again`: time of a second solve on the same solver, in plain products.
- `over first`: `plain` over that on the first number of ranks.
- `applications`: all work, in products on the target grid.
- `memory`: peak resident memory above that of the smallest grid, in doubles per cell.
- `contact`: share of the cells in contact.
- `residual`, `penetration`: rms gap in contact about its mean, and largest penetration, both over the rms of the
  undeformed distance about its mean. They and the error of the mean pressure are checked from the result file by a
  plain product; the limits are 1e-6, 1e-5 and 1e-6.
"""


def surface_grid(size):
    """Return the grid of the patch; an option makes it periodic."""
    return Grid.from_domain(size, size, (0.0, SIDE, 0.0, SIDE))


def distance(size, seed=1):
    """Return the undeformed distance between surface and flat body; the least is 0 [mm]."""
    grid = surface_grid(size)
    surface = SelfAffineSurface(0.8, SIDE / 8, 8 * SIDE / size, (SIDE, SIDE), seed, rms_slope=SLOPE)
    height = surface.height(grid.x(), grid.y())
    return height.max() - height


def mean_pressure(load):
    """Mean pressure of a load of `LOADS` [N/mm2]."""
    return load * MATERIAL.contact_modulus * SLOPE


def words(path, load):
    """Options that describe the problem to app.solve; `path`: file of the distances."""
    return [
        "-problem", "file", "-gap_file", str(path), "-domain", f"0,{SIDE:g},0,{SIDE:g}",
        "-shear_modulus", repr(MATERIAL.shear_modulus), "-poisson_ratio", repr(MATERIAL.poisson_ratio),
        "-periodic", "-mean_pressure", repr(mean_pressure(load)),
    ]  # fmt: skip


def write_page(sizes, ranks, options, output):
    """Measure all loads on all grids and numbers of ranks; write the page."""
    rows, memory, first = [], Memory(), {}
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        work = list(itertools.product(sorted(sizes), LOADS, ranks))
        for size, load, count in tqdm(work, desc="periodic", disable=None):
            path = folder / f"distance-{size}.npy"
            if not path.exists():
                np.save(path, distance(size))
            command = solve_command(words(path, load), options.method, count, folder / "result.h5")
            rows.append(_row(command, size, load, count, options.repeats, memory, first))
    publish(output, [head(options, "Benchmark on periodic patches"), PAGE, format_markdown(rows), ""])
    insist(rows)


def _row(command, size, load, count, repeats, memory, first):
    """Return a line of the table.

    `first` has the seconds of each size and load on the first number of ranks.
    """
    row = {"grid": f"{size}^2", "load": f"{load:g}", "ranks": count}

    def plain_product(_):
        return PlainPeriodicProduct(surface_grid(size), MATERIAL.contact_modulus)

    best, product, again, plain = quickest(command, repeats, plain_product)
    if isinstance(best, str):
        return row | {"note": best}
    facts, p = best.attributes, best.pressure
    found = check_periodic(product, p, best.undeformed_distance, mean_pressure(load))
    seconds = facts["solve_seconds"]
    accurate = (
        max(found["residual"], found["penetration"] / 10, found["tension"], found["load_error"]) <= 1e-6
    )
    return row | {
        "plain": f"{seconds / plain:.1f}",
        "again": f"{again / plain:.1f}",
        "over first": f"{seconds / first.setdefault((size, load), seconds):.2f}",
        "applications": f"{facts['operator_applications']:.1f}",
        "iterations": facts["active_set_iterations"],
        "seconds": f"{seconds:.3g}",
        "set-up": f"{facts['setup_seconds']:.2g}",
        "memory": memory((load, count), size, facts["peak_memory"]),
        "contact": f"{np.mean(p > 0):.1%}",
        "residual": f"{found['residual']:.1e}",
        "penetration": f"{found['penetration']:.1e}",
        "mean pressure": f"{found['load_error']:.0e}",
        "note": note_on(accurate),
    }
