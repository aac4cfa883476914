"""Seconds of the building blocks on one grid.

Started by `benchmarks.bench` as ``mpiexec -n P python -m benchmarks.kernels N``.
"""

import sys
import tracemalloc
from functools import partial

import numpy as np
from mpi4py import MPI

from app.halfspace.fft.multiplier import Layout
from app.halfspace.gauss_seidel.gauss_seidel import GaussSeidel
from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.material import Material
from app.halfspace.operator import InfluenceOperator
from app.methods.multilevel_operators import create_circulant_inverse, create_multilevel_influence
from app.parallel.slabs import Slabs
from app.problems.random_surfaces import WavySurface
from benchmarks.plain import seconds


def main():
    """Print ``name seconds`` lines (``memory``: doubles per cell)."""
    comm, size = MPI.COMM_WORLD, int(sys.argv[1])
    grid = Grid.from_domain(size, size, (-10, 10, -6, 6))
    kernel = Material.combined(82000, 0.28).kernel
    slabs = Slabs(size, comm.size, comm.rank)
    quadrant = partial(influence_quadrant, grid, kernel)
    x, y = grid.x()[None, :], grid.y(slabs.rows)[:, None]
    p = np.sqrt(np.clip(1 - (x / 6) ** 2 - (y / 4) ** 2, 0, None))
    u = np.empty_like(p)

    def measure(name, function, repeats=7):
        def together():
            comm.Barrier()
            function()
            comm.Barrier()

        together()
        shortest = seconds(together, repeats)
        if comm.rank == 0:
            print(name, shortest, flush=True)

    shared = kernel, slabs, comm if comm.size > 1 else None
    product = InfluenceOperator(grid, *shared).product  # imports
    tracemalloc.start()
    product = InfluenceOperator(grid, *shared).product
    if comm.size == 1:
        print("memory", tracemalloc.get_traced_memory()[0] / 8 / grid.n)
    tracemalloc.stop()
    measure("product", partial(product.apply, p, u))
    del product
    if comm.size > 1:
        return
    product = InfluenceOperator(grid, *shared, np.float32).product
    low, of_low = p.astype(np.float32), u.astype(np.float32)
    measure("product32", partial(product.apply, low, of_low))
    measure(
        "levels32",
        partial(create_multilevel_influence(grid, kernel, Layout(dtype=np.float32)).apply, low, of_low),
    )
    circulant = create_circulant_inverse(grid, kernel, apart=True)
    measure("circulant", partial(circulant.apply, p, u))
    sweeps = GaussSeidel(quadrant, grid.shape, slabs, comm)
    rough = WavySurface((48, 40), 0.95, 1.0, 7, (20.0, 12.0), (-10.0, -6.0)).height(grid.x(), grid.y())
    sets = {"sweep_hertz": p > 0, "sweep_rough": rough > np.quantile(rough, 0.7)}
    for name, contact in sets.items():
        r = np.where(contact, 1.0, 0.0)
        measure(name, partial(sweeps.sweep, r, contact, 0.8, u), 3)


if __name__ == "__main__":
    main()
