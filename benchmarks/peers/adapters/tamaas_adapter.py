"""Adapter of tamaas: Polonsky and Keer's CG by Rey et al.

Its ``dcfft`` operator serves patches that are not periodic.
"""

import os
import tempfile

import tamaas as tm
from protocol import Outcome, Variant, serve

VARIANTS = {
    "PolonskyKeerRey, dcfft": Variant("load"),
    "PolonskyKeerRey": Variant("load", periodic=True),
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    tm.initialize(1)
    tm.set_log_level(tm.LogLevel.info)  # the only place where it tells the number of iterations
    sizes = [problem.ny * problem.dy, problem.nx * problem.dx]
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, sizes, [problem.ny, problem.nx])
    model.E, model.nu = problem.contact_modulus, 0.0
    free = not VARIANTS[variant].periodic
    if free:
        tm.ModelFactory.registerNonPeriodic(model, "dcfft")

    def solve(tolerance):
        model.traction[...] = 0
        model.displacement[...] = 0
        solver = tm.PolonskyKeerRey(model, -problem.open_gap, tolerance)
        if free:
            solver.setIntegralOperator("dcfft")
        solver.max_iter = solver.dump_freq = 20000
        with tempfile.TemporaryFile() as log:
            kept = os.dup(2)
            os.dup2(log.fileno(), 2)
            try:
                error = solver.solve(problem.mean_pressure)
            finally:
                os.dup2(kept, 2)
                os.close(kept)
            log.seek(0)
            last = log.read().decode().splitlines()[-1].split()
        iterations = int(last[0])
        # Two products in an iteration: of the search direction, and of the new pressure.
        return Outcome(model.traction.copy(), iterations, converged=error <= tolerance)

    return solve


if __name__ == "__main__":
    serve(["tamaas", "numpy"], VARIANTS, prepare)
