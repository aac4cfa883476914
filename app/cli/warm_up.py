"""Compilation of all loops by numba in advance.

The command is ``contact-solve --warm-up``. `run/setup` compiles in two processes: one takes the solves of `CASES` from
the first to the last, the other from the last to the first, and each skips what the other has compiled.
"""

import warnings
from typing import NamedTuple

_LARGE = 640  # cells in x and y of a grid that is large enough for the products of large grids


class Case(NamedTuple):
    """Solve that uses loops which the other cases do not use."""

    cells: int = _LARGE  # in x and in y
    periodic: bool | str = False
    bodies: str = "plain"  # or coated, film
    hardness: float | None = None
    loading: str = "load"
    method: str | None = None
    precision: str = "single"
    wavy: bool = False
    stress: bool = False
    dilute: bool = False  # sampled shape, with contact of a few cells


CASES = (
    Case(hardness=2000, wavy=True),
    Case(precision="double", hardness=2000),
    Case(64, bodies="coated", stress=True),
    Case(256, bodies="film", hardness=2000, loading="approach"),
    Case(300, method="fmg_v11"),
    Case(1024, dilute=True),
    Case(periodic=True, precision="double", hardness=2000, bodies="coated"),
    Case(periodic=True, hardness=2000, loading="approach"),
    Case(periodic=True, bodies="coated"),
    # On several ranks also:
    Case(64, periodic=True),
    Case(64, periodic=True, precision="double"),
    Case(64, periodic="x", bodies="coated", loading="approach"),
)
_LOADINGS = {"load": 2000, "approach": 5e-3}


def compile_loops(backwards=False):
    """Compile all loops, by the solves of `CASES`. Collective."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for case in reversed(CASES) if backwards else CASES:
            _run(case)


def _run(case):
    import numpy as np

    from app.api.solver import solve
    from app.api.subsurface import stress
    from app.halfspace.grid import Grid
    from app.halfspace.material import Material
    from app.problems.contact_problem import ContactProblem
    from app.problems.shapes import Paraboloid

    grid = Grid.from_domain(case.cells, case.cells, (-1, 1, -1, 1))
    bodies = {
        "plain": lambda: Material.from_contact_modulus(1e5),
        "coated": lambda: Material.coated((2e5, 1e5), (0.3, 0.3), thickness=0.05),
        "film": lambda: Material.layer(1e5, 0.5, 0.01),
    }[case.bodies]()
    share = 1e-6 if case.dilute else 1.0
    shape, loading = Paraboloid(9, 7), {case.loading: share * _LOADINGS[case.loading]}
    if case.dilute:
        shape = grid.x() ** 2 / 18 + grid.y()[:, None] ** 2 / 14
    if case.wavy:
        shape, loading = (lambda x, y: 1e-3 * np.cos(20 * x) * np.cos(23 * y)), {"load": 3.9 * case.hardness}
    problem = ContactProblem(grid, bodies, shape, periodic=case.periodic, hardness=case.hardness)
    precision = {"lcp_precision": case.precision} if case.method is None and case.bodies != "film" else {}
    solution = solve(problem, method=case.method, options=precision, **loading).gather()
    if case.stress and solution:
        solution.flow()
        stress(solution, poisson_ratio=None if case.bodies == "coated" else 0.3).maximum()


def main(_):
    """Compile all loops; return the exit status. Collective."""
    from app.cli.session import print_output

    compile_loops()
    print_output("all loops are compiled")
