"""Adapter of this project: the default method on one rank."""

import math

from protocol import Outcome, Variant, serve

from app import ContactProblem, ContactSolver, Grid, Material

VARIANTS = {
    "by approach": Variant("approach", 1e-6),
    "by load": Variant("load", 1e-6),
    "periodic, by approach": Variant("approach", 1e-6, periodic=True),
    "periodic, by load": Variant("load", 1e-6, periodic=True),
}


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    how = VARIANTS[variant]
    grid = Grid(problem.nx, problem.ny, problem.dx, problem.dy, periodic=how.periodic)
    if math.isfinite(problem.thickness):
        material = Material.layer(problem.young, problem.poisson_ratio, problem.thickness)
    else:
        material = Material.combined(problem.shear_modulus, problem.poisson_ratio)
    hardness = problem.hardness if math.isfinite(problem.hardness) else None
    solver = ContactSolver(
        ContactProblem(grid, material, problem.gap, hardness=hardness),
        options={"lcp_rtol": how.first_tolerance},
    )

    def solve(_):
        found = solver.solve(**{how.control: getattr(problem, how.control)})
        return Outcome(found.pressure, found.iterations, found.operator_applications, found.converged)

    return solve


if __name__ == "__main__":
    serve(["elastic-contact-fmg", "numpy"], VARIANTS, prepare)
