"""ContactMechanics: Polonsky and Keer's CG, and NuMPI's bound-constrained CG on the pressures (`dual`)."""

from __future__ import annotations

import numpy as np
from ContactMechanics import FreeFFTElasticHalfSpace
from ContactMechanics.Systems import NonSmoothContactSystem
from protocol import Outcome, Variant, serve
from SurfaceTopography import Topography

VARIANTS = {
    "constrained CG": Variant("approach"),
    "dual, CG without restart": Variant("approach"),
    "dual, CG with restart": Variant("approach"),
    "constrained CG by force": Variant("load"),
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`. The package's first axis is x."""
    points, sizes = (problem.nx, problem.ny), (problem.nx * problem.dx, problem.ny * problem.dy)
    substrate = FreeFFTElasticHalfSpace(points, problem.contact_modulus, sizes)
    masked = not variant.startswith("dual")
    heights = -(problem.gap if masked else problem.open_gap).T
    if masked and np.isnan(heights).any():
        heights = np.ma.masked_invalid(heights)
    system = NonSmoothContactSystem(substrate, Topography(heights, sizes))
    depth = problem.approach - np.nanmin(problem.gap)
    cell_force = problem.load / problem.gap.size
    start = np.where(problem.interpenetrating.T, cell_force, 0.0)  # with restart it does not leave zero

    def constrained(tolerance):
        prescribed = {"offset": problem.approach}
        if VARIANTS[variant].control == "load":
            prescribed = {"external_force": problem.load}
        result = system.minimize_proxy(
            **prescribed,
            pentol=tolerance * depth,
            forcetol=tolerance * cell_force,
            thermotol=tolerance,
            maxiter=20000,
        )
        return outcome(np.ma.filled(result.jac, 0.0), result.nit, result.nfev, result.success)

    def dual(tolerance):
        result = system.dual_minimize_proxy(
            problem.approach,
            init_force=start,
            solver="ccg-" + variant.split("CG ")[1].replace(" ", "-"),
            gtol=tolerance * depth,
            maxiter=20000,
        )
        return outcome(result.x.reshape(points), result.nit, 2 * result.nit + 1, result.success)

    def outcome(force, iterations, products, success):
        return Outcome(force.T / problem.cell_area, iterations, products, bool(success))

    return dual if variant.startswith("dual") else constrained


if __name__ == "__main__":
    serve(["ContactMechanics", "NuMPI", "muGrid", "numpy"], VARIANTS, prepare)
