"""Adapter of ContactMechanics: Polonsky and Keer's CG, and NuMPI's bound-constrained CG."""

import numpy as np
from ContactMechanics import FreeFFTElasticHalfSpace, PeriodicFFTElasticHalfSpace
from ContactMechanics.Systems import NonSmoothContactSystem
from NuMPI.Optimization.CCGWithoutRestart import constrained_conjugate_gradients
from protocol import Counted, Outcome, Variant, serve
from SurfaceTopography import Topography

VARIANTS = {
    "dual, CG without restart": Variant("approach"),
    "dual, CG with restart": Variant("approach"),
    "constrained CG": Variant("approach"),
    "constrained CG by force": Variant("load"),
    "periodic constrained CG by force": Variant("load", periodic=True),
    "periodic constrained CG by force, hardness": Variant("load", periodic=True, hardness=True),
    "periodic constrained CG by force, layer": Variant("load", periodic=True, layer=True),
    "periodic dual, CG without restart by mean force": Variant("load", periodic=True),
    "periodic dual, CG without restart": Variant("approach", periodic=True),
    "periodic dual, CG with restart": Variant("approach", periodic=True),
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`. The package's first axis is x."""
    points, sizes = (problem.nx, problem.ny), (problem.nx * problem.dx, problem.ny * problem.dy)
    masked = "dual" not in variant
    if VARIANTS[variant].layer:
        layer = {"thickness": problem.thickness, "poisson": problem.poisson_ratio}
        substrate = PeriodicFFTElasticHalfSpace(points, problem.young, sizes, **layer)
    elif VARIANTS[variant].periodic:
        # 0.0: displacements of mean 0, as everybody else's; its own constrained CG stops at once with it, and its
        # approach is not asked for.
        uniform = None if masked else 0.0
        substrate = PeriodicFFTElasticHalfSpace(points, problem.contact_modulus, sizes, stiffness_q0=uniform)
    else:
        substrate = FreeFFTElasticHalfSpace(points, problem.contact_modulus, sizes)
    product = substrate.evaluate_disp = Counted(substrate.evaluate_disp)  # the only place where it transforms
    heights = -(problem.gap if masked else problem.open_gap).T
    if masked and np.isnan(heights).any():
        heights = np.ma.masked_invalid(heights)
    system = NonSmoothContactSystem(substrate, Topography(heights, sizes))
    known = np.isfinite(problem.approach)
    depth = problem.approach - np.nanmin(problem.gap) if known else np.nanstd(problem.gap)
    cell_force = problem.load / problem.gap.size
    # with restart it does not leave zero
    start = np.where(problem.interpenetrating.T, cell_force, 0.0) if known else np.full(points, cell_force)

    def constrained(tolerance):
        prescribed = {"offset": problem.approach}
        if VARIANTS[variant].control == "load":
            prescribed = {"external_force": problem.load}
        if VARIANTS[variant].hardness:
            prescribed["hardness"] = problem.hardness * problem.cell_area
        result = system.minimize_proxy(
            **prescribed,
            pentol=tolerance * depth,
            forcetol=tolerance * cell_force,
            thermotol=tolerance,
            maxiter=20000,
        )
        return outcome(np.ma.filled(result.jac, 0.0), result)

    def dual(tolerance):
        result = system.dual_minimize_proxy(
            problem.approach,
            init_force=start,
            solver="ccg-" + variant.split("CG ")[1].replace(" ", "-"),
            gtol=tolerance * depth,
            maxiter=20000,
        )
        return outcome(result.x.reshape(points), result)

    def dual_by_force(tolerance):
        result = constrained_conjugate_gradients(
            system.dual_objective(0.0),
            system.dual_hessian_product,
            np.full(points, cell_force),
            mean_val=cell_force,
            gtol=tolerance * depth,
            maxiter=20000,
        )
        return outcome(result.x.reshape(points), result)

    def outcome(force, result):
        products, product.calls = product.calls, 0
        return Outcome(force.T / problem.cell_area, result.nit, products, bool(result.success))

    if masked:
        return constrained
    return dual_by_force if variant.endswith("by mean force") else dual


if __name__ == "__main__":
    serve(["ContactMechanics", "SurfaceTopography", "NuMPI", "muGrid", "numpy"], VARIANTS, prepare)
