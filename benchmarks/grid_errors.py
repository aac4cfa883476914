"""Count how often estimated grid errors are upper bounds: ``python -m benchmarks.grid_errors``.

Every problem is solved on some grids under some loadings; true errors are differences from Hertz's solution, or from
that on 1024 x 1024 cells. Prints the table of docs/load-paths.md.
"""

import numpy as np
from tqdm import tqdm

from app import (
    Cone,
    ContactProblem,
    ContactSolver,
    Cylinder,
    Grid,
    Material,
    Paraboloid,
    SelfAffineSurface,
    Sphere,
)
from app.base.errors import InputError
from app.io.table import format_markdown

STEEL = Material.combined(80000.0, 0.3)
SIZES, FINEST = (32, 64, 128, 256, 512), 1024
CONVERGES = 0.05  # true error of a number that is said not to converge, and does
NUMBERS = {
    "load": "load, by approach",
    "approach": "approach, by load",
    "max_pressure": "maximum pressure",
    "contact_area": "contact area",
}


def _problems(shape=None, *, seed=None, slope=0.1, cut_off=1 / 32, periodic=False):
    """Return a function that makes the problem on n x n cells of a patch of 1 mm."""
    surfaces = [SelfAffineSurface(0.8, 1 / 4, cut_off, (1.0, 1.0), seed, rms_slope=slope)] if seed else ()

    def problem(n):
        grid = Grid.from_domain(n, n, (-0.5, 0.5, -0.5, 0.5))
        return ContactProblem(grid, STEEL, shape, surfaces=surfaces, periodic=periodic)

    return problem


def _off_centre(x, y):
    return ((x - 0.11) ** 2 + (y + 0.07) ** 2) / 4


def _rounded_punch(flat, radius):
    """Return the shape of a flat round punch with a rounded edge [mm]."""
    return lambda x, y: np.maximum(np.hypot(x, y) - flat, 0.0) ** 2 / (2 * radius)


_SMOOTH, _ROUGH = (1e-4, 3e-4, 1e-3, 3e-3), (1e-3, 5e-3, 2e-2, 6e-2)  # mean pressures over E*


def _on_a_plane(periodic):
    spectra = (1, 1 / 32), (2, 1 / 64), (3, 1 / 8)
    return [(_problems(seed=seed, cut_off=cut_off, periodic=periodic), _ROUGH) for seed, cut_off in spectra]


# Problem of n, and mean pressures, by name.
PROBLEMS = {
    "Hertz": [(_problems(Paraboloid(2.0, 2.0)), _SMOOTH)],
    "sphere, off centre": [(_problems(_off_centre), _SMOOTH)],
    "cone": [(_problems(Cone(2.0)), _SMOOTH)],
    "punch with rounded rim": [
        (_problems(_rounded_punch(*sizes)), _SMOOTH)
        for sizes in ((0.2, 0.02), (0.2, 0.1), (0.2, 0.5), (0.25, 0.05))
    ],
    "roller with sharp ends": [
        (_problems(Cylinder(*sizes)), _SMOOTH) for sizes in ((2.0, 0.6), (2.0, 0.53), (5.0, 0.6))
    ],
    "rough sphere": [
        (_problems(Sphere(2.0), seed=seed, slope=0.02, cut_off=cut_off), _SMOOTH)
        for seed, cut_off in ((1, 1 / 32), (2, 1 / 32), (3, 1 / 128), (4, 1 / 128))
    ],
    "rough periodic surface": _on_a_plane(periodic=True),
    "rough flat surface, not periodic": _on_a_plane(periodic=False),
}


def _solve_all(problem, loadings, size):
    """Solve under all loadings on size x size cells; nothing if the cells are too large for the waves."""
    try:
        asked = problem(size)
    except InputError:
        return []
    with ContactSolver(asked) as solver:
        return [solver.solve(**loading) for loading in loadings]


def _error(name, solution, finest):
    """Return the relative error against Hertz, or against the finest grid.

    The approach counts from first touch.
    """
    value, right = getattr(solution, name), solution.attributes.get(f"analytic_{name}", getattr(finest, name))
    touching = np.nanmin(solution.undeformed_distance) if name == "approach" else 0.0
    return abs(value - right) / (right - touching) if np.isfinite(right) else 1.0


def cases():
    """Yield name, number, true and estimated error of all problems, by load and by approach."""
    work = [(name, *each) for name, group in PROBLEMS.items() for each in group]
    for name, problem, shares in tqdm(work, disable=None):
        by_load = [{"mean_pressure": share * STEEL.contact_modulus} for share in shares]
        finest = _solve_all(problem, by_load, FINEST)
        by_approach = [{"approach": best.approach} for best in finest]
        for size in SIZES:
            for loadings, given in (by_load, "load"), (by_approach, "approach"):
                for found, best in zip(_solve_all(problem, loadings, size), finest, strict=False):
                    for number in NUMBERS.keys() - {given}:
                        estimated = getattr(found, f"{number}_error")
                        if estimated == estimated:
                            yield name, number, _error(number, found, best), estimated


def rows(found):
    """Yield a row for each problem: the share of upper bounds, and of false divergence."""
    for name in PROBLEMS:
        row = {"": name}
        for number, title in NUMBERS.items():
            pairs = np.array([case[-2:] for case in found if case[:2] == (name, number)])
            if pairs.size:
                error, estimated = pairs.T
                row[title] = f"{np.sum(error <= estimated)} of {len(pairs)}"
                false = np.sum((estimated == 1) & (error < CONVERGES))
                row[title] += f"; {false} false alarm{'s'[: false != 1]}" if false else ""
        yield row


if __name__ == "__main__":
    all_cases = list(cases())
    print(format_markdown(list(rows(all_cases))))
    for number, title in NUMBERS.items():
        ratio = [estimated / error for _, of, error, estimated in all_cases if of == number and error > 0]
        half, tenth = np.percentile(ratio, [50, 90])
        print(
            f"{title}: half of the errors are exceeded more than {half:.0f} times, a tenth more than {tenth:.0f} times"
        )
