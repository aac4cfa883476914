"""Checks that symmetries and changes of units change answers as expected."""

from dataclasses import replace

import numpy as np

from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.contact_problem import ContactProblem
from app.verification.check import Check, Figure
from app.verification.solving import UNIT, difference, patch_name, patches, solved

_GRID = Grid(40, 31, 0.3, 0.2, x0=-6.0, y0=-3.1)
_APPROACH = 0.05
_TIGHT = {"lcp_rtol": 1e-12}
_METHODS = {"norm": _TIGHT, None: _TIGHT | {"lcp_precision": "double"}}
_MAX_DIFFERENCE = 1e-9  # Limit on differences of pressures, over the largest.


def bumps(x, y):
    """Return a gap without symmetry, with several places of contact [mm]."""
    waves = 0.05 * (np.sin(2 * x + 1) + np.cos(3.1 * y + 0.4 * x))
    return waves + 0.02 * (x - 0.3) ** 2 + 0.03 * (y + 0.2) ** 2


def _problem(periodic, grid=_GRID, gap=None):
    gap = bumps(*np.meshgrid(_GRID.x(), _GRID.y())) if gap is None else gap
    return ContactProblem(grid, UNIT, gap, periodic=periodic)


def _each(change):
    """Return a check of an invariance, from `change`.

    ``change(problem, before)`` yields other problems, their loadings and expected pressures; `before` is the solution
    of `problem`.
    """

    def measure(quick):
        figures = []
        for periodic in patches(quick):
            for method, options in _METHODS.items():
                problem = _problem(periodic)
                before = solved(problem, method, options=options, approach=_APPROACH)
                worst, off = 0.0, 0
                for other, loading, expected in change(problem, before):
                    after = solved(other, method, options=options, **loading)
                    off += not (before.converged and after.converged)
                    worst = max(worst, difference(after.pressure, expected))
                kind = f"{patch_name(periodic)}, {method or 'default'}"
                worst = np.nan if off else worst
                figures.append(Figure(f"difference of pressures, {kind}", worst, most=_MAX_DIFFERENCE))
        return figures

    return measure


def _at(approach=_APPROACH):
    return {"approach": approach}


def mirror(problem, before):
    """Mirror the bodies: pressures are mirrored, too."""
    for flip in (np.s_[::-1, :], np.s_[:, ::-1], np.s_[::-1, ::-1]):
        yield replace(problem, gap=problem.gap[flip].copy()), _at(), before.pressure[flip]


def transposition(problem, before):
    """Exchange x and y: pressures are transposed."""
    grid = problem.grid
    periodic = {"x": "y", "y": "x"}.get(grid.periodic, grid.periodic)
    turned = Grid(grid.ny, grid.nx, grid.dy, grid.dx, periodic=periodic)
    yield ContactProblem(turned, problem.material, problem.gap.T.copy()), _at(), before.pressure.T


def translation(problem, before):
    """Shift the origin, or the heights of a periodic patch: pressures shift."""
    elsewhere = replace(problem.grid, x0=100.0, y0=-7.0)
    yield replace(problem, grid=elsewhere), _at(), before.pressure
    if problem.grid.periodic:
        shift = [step * repeats for step, repeats in zip((5, 7), problem.grid.repeats, strict=True)], (0, 1)
        yield replace(problem, gap=np.roll(problem.gap, *shift)), _at(), np.roll(before.pressure, *shift)


def stiffness(problem, before):
    """Multiply E* by a factor: pressures are multiplied by it."""
    for material, factor in (
        (Material.combined(7 * UNIT.shear_modulus, 0.0), 7),
        (Material.combined(UNIT.shear_modulus, 0.5), 2),
    ):
        yield replace(problem, material=material), _at(), factor * before.pressure


def heights(problem, before):
    """Multiply heights by a factor: pressures are multiplied by it."""
    yield replace(problem, gap=3 * problem.gap), _at(3 * _APPROACH), 3 * before.pressure


def lengths(problem, before):
    """Multiply lengths by a factor: pressures stay, loads grow by its square."""
    grid = problem.grid
    grid = replace(grid, dx=5 * grid.dx, dy=5 * grid.dy, x0=5 * grid.x0, y0=5 * grid.y0)
    larger = replace(problem, grid=grid, gap=5 * problem.gap)
    yield larger, _at(5 * _APPROACH), before.pressure
    yield larger, {"load": 25 * before.load}, before.pressure


def offset(problem, before):
    """Add a constant to distance and approach: nothing changes."""
    yield replace(problem, gap=problem.gap + 1), _at(1 + _APPROACH), before.pressure


def loadings(problem, before):
    """Prescribe the same contact by approach, load, mean pressure, mean gap."""
    yield problem, {"load": before.load}, before.pressure
    yield problem, {"mean_pressure": before.mean_pressure}, before.pressure
    if problem.grid.doubly_periodic:
        yield problem, {"mean_gap": before.mean_gap}, before.pressure


def larger_patch(quick):
    """Add cells that cannot come into contact: nothing changes."""
    figures = []
    for method, options in _METHODS.items():
        before = solved(_problem(""), method, options=options, approach=_APPROACH)
        wide = Grid(50, 40, _GRID.dx, _GRID.dy)
        expected = np.zeros(wide.shape)
        expected[4:35, 7:47] = before.pressure
        for name, outside in (("far away", 10.0), ("impossible", np.nan)):
            gap = np.full(wide.shape, outside)
            gap[4:35, 7:47] = _problem("").gap
            after = solved(
                _problem("", wide, gap), method, options=options | {"lcp_rtol": 1e-13}, approach=_APPROACH
            )
            what = f"difference of pressures, cells beside it {name}, {method or 'default'}"
            figures.append(Figure(what, difference(after.pressure, expected), most=_MAX_DIFFERENCE))
    return figures


CHECKS = (
    *(
        Check(change.__name__, change.__name__.capitalize(), change.__doc__, _each(change))
        for change in (mirror, transposition, translation, stiffness, heights, lengths, offset, loadings)
    ),
    Check("larger-patch", "A larger patch", larger_patch.__doc__, larger_patch),
)
