"""Adapter of aspher: nested grids, preconditioned projected CG by load.

Products are by FMM (h2) or FFT, on square patches only.
"""

import aspher
from protocol import Outcome, Variant, serve

NESTED = {
    "nested, fft": {"backend": "fft"},
    "nested, fft, float then double": {"backend": "fft", "precision": "float_then_double"},
    "nested, h2": {},
    "nested, h2, active set": {"active_set": True},
    "nested": {"backend": "periodic"},
    "nested, float then double": {"backend": "periodic", "precision": "float_then_double"},
}
ONE_GRID = {
    "fft, one grid": {"backend": "fft"},
    "one grid": {"backend": "periodic"},
}
VARIANTS = {
    name: Variant("load", 1e-6, how.get("backend") == "periodic", dilute=how.get("active_set", False))
    for name, how in (NESTED | ONE_GRID).items()
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    size = {
        "grid_size": problem.nx,
        "domain_size": problem.nx * problem.dx,
        "E_star": problem.contact_modulus,
    }
    gap = problem.open_gap.ravel()
    if variant not in NESTED:
        solver = aspher.ContactSolver(**size, **ONE_GRID[variant])
        return lambda tolerance: outcome(
            solver.solve(gap, problem.mean_pressure, tol=tolerance, max_iter=20000, precond="fourier-fft")
        )
    coarsest = problem.nx
    while coarsest > 64 and coarsest % 2 == 0:
        coarsest //= 2

    def solve(tolerance):
        return outcome(
            aspher.solve_nested(
                **size,
                gap=gap,
                p_nominal=problem.mean_pressure,
                coarsest=coarsest,
                tol=tolerance,
                **NESTED[variant],
            )
        )

    return solve


def outcome(result):
    """Products are those on the finest grid."""
    return Outcome(
        result.pressure, result.iterations, result.matvec_count, result.converged, result.timings["build"]
    )


if __name__ == "__main__":
    serve(["aspher", "numpy"], VARIANTS, prepare, square=True)
