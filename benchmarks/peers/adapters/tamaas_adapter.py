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
    "KatoSaturated": Variant("load", periodic=True, hardness=True),
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    tm.initialize(1)
    tm.set_log_level(tm.LogLevel.info)  # the only place where it tells the number of iterations
    sizes = [problem.ny * problem.dy, problem.nx * problem.dx]
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, sizes, [problem.ny, problem.nx])
    # The steps of KatoSaturated have a fixed size, and are stable if the largest eigenvalue of the model is below 2.
    unit = 6 * problem.contact_modulus / max(sizes) if VARIANTS[variant].hardness else 1.0
    model.E, model.nu = problem.contact_modulus / unit, 0.0
    free = not VARIANTS[variant].periodic
    if free:
        tm.ModelFactory.registerNonPeriodic(model, "dcfft")

    def solve(tolerance):
        model.traction[...] = 0
        model.displacement[...] = 0
        if VARIANTS[variant].hardness:
            solver = tm.KatoSaturated(model, -problem.open_gap, tolerance, problem.hardness / unit)
        else:
            solver = tm.PolonskyKeerRey(model, -problem.open_gap, tolerance)
        if free:
            solver.setIntegralOperator("dcfft")
        solver.max_iter = solver.dump_freq = 20000
        with tempfile.TemporaryFile() as log:
            kept = os.dup(2)
            os.dup2(log.fileno(), 2)
            try:
                error = solver.solve(problem.mean_pressure / unit)
            finally:
                os.dup2(kept, 2)
                os.close(kept)
            log.seek(0)
            table = [line.split()[0] for line in log.read().decode().splitlines()]
        # KatoSaturated prints several tables.
        iterations = sum(
            int(last) for last, head in zip(table, [*table[1:], "Iter"], strict=True) if head == "Iter"
        )
        # Two products in an iteration: of the search direction, and of the new pressure.
        return Outcome(unit * model.traction, iterations, converged=error <= tolerance)

    return solve


if __name__ == "__main__":
    serve(["tamaas", "numpy"], VARIANTS, prepare)
