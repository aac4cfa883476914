"""Cost of solving by load and by approach, for self-affine surfaces.

Started by `benchmarks.bench` as ``mpiexec -n P python -m benchmarks.loads N [METHOD]``; prints a line of JSON for each
problem. The approach is the one that belongs to the load, so that both end with the same pressure.
"""

import json
import sys
from dataclasses import dataclass

from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, Material
from app.problems.random_surfaces import SelfAffineSurface

SIDE, SLOPE = 1.0, 0.1  # of the patch [mm], rms
MATERIAL = Material.combined(80000.0, 0.3)
SEEDS = (1, 2, 3)
# Mean pressure / (E* rms slope): contact from 0.1% of the cells to 99%.
LOADS = (0.0004, 0.003, 0.02, 0.09, 0.2, 0.4, 0.9, 2.0)


@dataclass(frozen=True)
class Spectrum:
    """Hurst exponent, roll-off wavelength [mm], shortest wavelength in cells or mm."""

    hurst: float
    rolloff: float
    cells: int = 0
    shortest: float = 0.0

    def __str__(self):
        cutoff = f"{self.cells} cells" if self.cells else f"1/{1 / self.shortest:g}"
        return f"{self.hurst:g}, 1/{1 / self.rolloff:g}, {cutoff}"

    def height(self, grid, seed):
        """Heights in the cells [mm]."""
        shortest = self.cells * grid.dx if self.cells else self.shortest
        surface = SelfAffineSurface(
            self.hurst, self.rolloff, shortest, (SIDE, SIDE), seed, rms_slope=SLOPE
        )  # fmt: skip
        return surface.height(grid.x(), grid.y())


# The finer the cut-off, the more the contact is made of single cells; the coarser the roll-off, the higher the summits.
SPECTRA = (
    Spectrum(0.8, SIDE / 8, cells=4),
    Spectrum(0.8, SIDE / 8, shortest=SIDE / 32),
    Spectrum(0.5, SIDE / 2, cells=8),
)


def measure(size, spectrum, seed, method=None, comm=MPI.COMM_WORLD):
    """Solve for all `LOADS` and for their approaches; yield a row for each.

    Collective.
    """
    grid = Grid.from_domain(size, size, (0.0, SIDE, 0.0, SIDE))
    height = spectrum.height(grid, seed)
    problem = ContactProblem(grid, MATERIAL, height.max() - height)
    with ContactSolver(problem, method=method, comm=comm) as solver:
        for load in LOADS:
            by_load = solver.solve(load=load * MATERIAL.contact_modulus * SLOPE * SIDE**2)
            by_approach = solver.solve(approach=by_load.approach)
            yield {
                "grid": size,
                "ranks": comm.size,
                "spectrum": str(spectrum),
                "seed": seed,
                "load": load,
                "contact": by_load.contact_fraction,
                **_described("approach", by_approach),
                **_described("load", by_load),
            }


def _described(control, solution):
    facts = {
        "converged": solution.converged,
        "applications": solution.operator_applications,
        "iterations": solution.iterations,
        "fallbacks": solution.fallbacks,
        "error_bound": solution.error_bound,
        "seconds": solution.solve_seconds,
    }
    return {f"by_{control}_{name}": value for name, value in facts.items()}


def main():
    """Print the rows of one grid."""
    size, method = int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None
    next(measure(64, SPECTRA[0], SEEDS[0], method))  # the first solve of a process is slower
    for spectrum in SPECTRA:
        for seed in SEEDS:
            for row in measure(size, spectrum, seed, method):
                if MPI.COMM_WORLD.rank == 0:
                    print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
