"""Compilation of all loops by numba in advance.

The command is ``contact-solve --warm-up``.
"""

import warnings

METHODS = "fast", "primal", "film", "norm", "fmg_v11"  # method files that together use all loops
_LARGE = 640  # cells in x and y of a grid that is large enough for the products of large grids


def compile_loops(methods=METHODS):  # run/setup passes methods
    """Compile all loops, by a solve with each method and a stress. Collective."""
    from app.api.solver import solve
    from app.api.subsurface import stress
    from app.halfspace.grid import Grid
    from app.halfspace.material import Material
    from app.problems.contact_problem import ContactProblem
    from app.problems.shapes import Paraboloid

    material = Material.from_contact_modulus(1e5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for method in methods:
            n = _LARGE if method == "fast" else 256
            grid = Grid.from_domain(n, n, (-1, 1, -1, 1))
            bodies = Material.layer(1e5, 0.5, 0.01) if method == "film" else material
            problem = ContactProblem(grid, bodies, Paraboloid(9, 7), periodic=method == "primal")
            solution = solve(problem, load=5000, method=method).gather()
            if method == "norm" and solution:
                stress(solution, poisson_ratio=0.3).maximum()


def main(_):
    """Compile all loops; return the exit status. Collective."""
    from app.cli.session import print_output

    compile_loops()
    print_output("all loops are compiled")
