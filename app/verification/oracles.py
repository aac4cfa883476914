"""Comparisons with independent solvers.

The independent solvers share only the influence coefficients, or the product with A, with the solvers under test.
"""

import numpy as np

from app.verification.check import Check, Figure
from app.verification.dense import DenseProblem, solve_by_lemke
from app.verification.solving import (
    PATCHES,
    approach_at,
    difference,
    methods,
    patch_name,
    patches,
    random_problem,
    solved,
    with_hardness,
)

_TIGHT = {"lcp_rtol": 1e-12}


def lemke(quick):
    """Compare methods with Lemke's pivoting in rational numbers."""
    figures, rng = [], np.random.default_rng(1)
    for periodic in PATCHES:
        worst = {"norm": 0.0, None: 0.0}
        for _ in range(6 if quick else 40):
            problem = random_problem(rng, *rng.integers(1 + bool(periodic), 4, 2), periodic)
            approach = approach_at(problem, rng.choice([0.2, 0.7, 0.95]))
            dense = DenseProblem(problem)
            inside = dense.inside
            h = (problem.gap.ravel() - approach)[inside]
            exact = np.zeros(inside.size)
            exact[inside] = solve_by_lemke(dense.matrix[np.ix_(inside, inside)], h)
            for method in worst:
                found = solved(problem, method, options=_TIGHT, approach=approach)
                off = difference(found.pressure.ravel(), exact)
                worst[method] = max(worst[method], off if found.converged else np.inf)
        kind = patch_name(periodic)
        figures += [
            Figure(f"difference of pressures, {kind}, {m or 'default'}", w, most=1e-9)
            for m, w in worst.items()
        ]
    return figures


def by_snesvi(quick):
    """Compare with SNESVI, elastic and with a hardness."""
    figures, rng = [], np.random.default_rng(2)
    for periodic in patches(quick):
        worst = 0.0
        for _ in range(1 if quick else 5):
            problem = random_problem(rng, *((12, 10) if quick else (24, 20)), periodic)
            loading = {"approach": approach_at(problem, rng.choice([0.2, 0.7, 0.95]))}
            ours = solved(problem, options={"lcp_rtol": 1e-10}, **loading)
            for case in problem, with_hardness(rng, problem, ours.max_pressure):
                theirs = solved(case, options={"lcp_type": "snesvi", "lcp_rtol": 1e-10}, **loading)
                ours = solved(case, options={"lcp_rtol": 1e-10}, **loading)
                off = difference(ours.pressure, theirs.pressure)
                worst = max(worst, off if ours.converged and theirs.converged else np.inf)
        figures.append(Figure(f"difference of pressures, {patch_name(periodic)}", worst, most=1e-6))
    return figures


def _by_every_method(periodic, cases, bounded=False):
    """Return figures that compare every method with pivoting.

    A case is a problem, its DenseProblem, a loading and the exact pressure. If `bounded` is true, errors are compared
    with their bounds, too.
    """
    figures = []
    for method in methods(periodic):
        differences, ratios = [], []
        for problem, dense, loading, exact in cases:
            found = solved(problem, method, options={"lcp_rtol": 1e-9}, **loading)
            if found.converged:
                differences.append(difference(found.pressure, exact))
                error, size = (dense.energy(p) for p in (found.pressure - exact, found.pressure))
                ratios.append(error / (found.error_bound * size or np.inf))
        kind, worst = f"{patch_name(periodic)}, {method}", max(differences, default=np.nan)
        figures.append(Figure(f"difference of pressures, {kind}, {len(cases)} solves", worst, most=1e-6))
        if bounded:
            figures.append(
                Figure(f"largest error over its bound, {kind}", max(ratios, default=np.nan), most=1)
            )
        figures.append(Figure(f"not solved, and said so, {kind}", len(cases) - len(differences), most=0))
    return figures


def every_method(quick):
    """Compare with pivoting on the dense matrix in extended precision."""
    figures, rng = [], np.random.default_rng(3)
    for periodic in patches(quick):
        counts = range(1 if quick else 6)
        problems = [random_problem(rng, 12, 9 - k % 2, periodic, holes=k % 2 == 1) for k in counts]
        cases = []
        for problem in problems:
            approach, dense = approach_at(problem, rng.choice([0.3, 0.8, 0.95])), DenseProblem(problem)
            exact = dense.at(approach)
            load = problem.grid.cell_area * float(exact.sum())
            ways = {"approach": approach, "load": load, "mean_pressure": load / problem.grid.area}
            if problem.grid.doubly_periodic and not np.isnan(problem.gap).any():
                ways["mean_gap"] = problem.gap.mean() - approach
            cases += [(problem, dense, {name: number}, exact) for name, number in ways.items()]
        figures += _by_every_method(periodic, cases)
    return figures


def plastic_contact(quick):
    """Compare with pivoting, with a hardness of each cell."""
    figures, rng = [], np.random.default_rng(7)
    for periodic in patches(quick):
        cases = []
        for k in range(1 if quick else 6):
            elastic = random_problem(rng, 12, 9 - k % 2, periodic, holes=k % 2 == 1)
            approach = approach_at(elastic, 0.8)
            problem = with_hardness(rng, elastic, float(DenseProblem(elastic).at(approach).max()))
            dense = DenseProblem(problem)
            exact = dense.at(approach)
            loads = [problem.grid.cell_area * float(exact.sum())]
            if np.isfinite(dense.largest_load):
                loads += [share * dense.largest_load for share in (0.9, 1 - 1e-6, 1.0)]
            cases.append((problem, dense, {"approach": approach}, exact))
            cases += [(problem, dense, {"load": load}, dense.under(load, approach)[0]) for load in loads]
        figures += _by_every_method(periodic, cases, bounded=True)
    return figures


def larger_grids(quick):
    """Compare with NORM solved to 1e-10, on grids too large for a matrix."""
    figures, rng = [], np.random.default_rng(4)
    for periodic in patches(quick=True):
        problem = random_problem(rng, *((32, 24) if quick else (128, 96)), periodic, holes=False)
        loading = {"approach": approach_at(problem, 0.5)}
        exact = solved(problem, "norm", options={"lcp_rtol": 1e-10}, **loading)
        for method in methods(periodic):
            found = solved(problem, method, options={"lcp_rtol": 1e-8}, **loading)
            off = difference(found.pressure, exact.pressure) if found.converged else np.inf
            figures.append(
                Figure(f"difference of pressures, {patch_name(periodic)}, {method}", off, most=1e-5)
            )
    return figures


CHECKS = (
    Check("lemke", "Lemke's method", "The exact solution in rational numbers, on up to nine cells.", lemke),
    Check("snesvi", "PETSc's SNESVI", "Variational inequalities, with the same product.", by_snesvi),
    Check("methods", "Every method by every loading", every_method.__doc__, every_method),
    Check("hardness", "Every method with a hardness", plastic_contact.__doc__, plastic_contact),
    Check("methods-larger", "Every method on larger grids", larger_grids.__doc__, larger_grids),
)  # fmt: skip
