"""Comparisons with independent solvers.

The independent solvers share only the influence coefficients, or the product with A, with the solvers under test.
"""

import numpy as np

from app.verification.check import Check, Figure
from app.verification.dense import DenseProblem, solve_by_lemke
from app.verification.solving import PATCHES, difference, methods, random_problem, solved, with_hardness

_TIGHT = {"lcp_rtol": 1e-12}


def _approach(problem, share):
    """Return an approach between first touch and the mean gap [mm].

    `share` is 0 at first touch, and 1 at the mean gap.
    """
    least = np.nanmin(problem.gap)
    return least + share * (np.nanmean(problem.gap) - least)


def lemke(quick):
    """Compare methods with Lemke's pivoting in rational numbers."""
    figures, rng = [], np.random.default_rng(1)
    for periodic in PATCHES:
        worst = {"norm": 0.0, None: 0.0}
        for _ in range(6 if quick else 40):
            problem = random_problem(rng, *rng.integers(1 + bool(periodic), 4, 2), periodic)
            approach = _approach(problem, rng.choice([0.2, 0.7, 0.95]))
            dense = DenseProblem(problem)
            inside = dense.inside
            h = (problem.gap.ravel() - approach)[inside]
            exact = np.zeros(inside.size)
            exact[inside] = solve_by_lemke(dense.matrix[np.ix_(inside, inside)], h)
            for method in worst:
                found = solved(problem, method, options=_TIGHT, approach=approach)
                off = difference(found.pressure.ravel(), exact)
                worst[method] = max(worst[method], off if found.converged else np.inf)
        kind = periodic or "free"
        figures += [
            Figure(f"difference of pressures, {kind}, {m or 'default'}", w, most=1e-9)
            for m, w in worst.items()
        ]
    return figures


def _by_petsc(kind):
    def measure(quick):
        figures, rng = [], np.random.default_rng(2)
        for periodic in PATCHES[: 2 if quick else 3]:
            worst = 0.0
            for _ in range(1 if quick else 5):
                problem = random_problem(rng, *((12, 10) if quick else (24, 20)), periodic)
                loading = {"approach": _approach(problem, rng.choice([0.2, 0.7, 0.95]))}
                ours = solved(problem, options={"lcp_rtol": 1e-10}, **loading)
                for case in problem, with_hardness(rng, problem, ours.max_pressure):
                    theirs = solved(case, options={"lcp_type": kind, "lcp_rtol": 1e-10}, **loading)
                    ours = solved(case, options={"lcp_rtol": 1e-10}, **loading)
                    off = difference(ours.pressure, theirs.pressure)
                    worst = max(worst, off if ours.converged and theirs.converged else np.inf)
            figures.append(Figure(f"difference of pressures, {periodic or 'free'}", worst, most=1e-6))
        return figures

    return measure


def every_method(quick):
    """Compare with pivoting on the dense matrix in extended precision."""
    figures, rng = [], np.random.default_rng(3)
    for periodic in PATCHES[: 2 if quick else 3]:
        problems = [
            random_problem(rng, 12, 9 - k % 2, periodic, holes=k % 2 == 1) for k in range(1 if quick else 6)
        ]
        truths = []
        for problem in problems:
            approach = _approach(problem, rng.choice([0.3, 0.8, 0.95]))
            truths.append((approach, DenseProblem(problem).at(approach).astype(float)))
        for method in methods(bool(periodic)):
            differences, solves = [], 0
            for problem, (approach, exact) in zip(problems, truths, strict=True):
                load = problem.grid.cell_area * exact.sum()
                ways = {"approach": approach, "load": load, "mean_pressure": load / problem.grid.area}
                if periodic and not np.isnan(problem.gap).any():
                    ways["mean_gap"] = problem.gap.mean() - approach
                for loading, number in ways.items():
                    found = solved(problem, method, options={"lcp_rtol": 1e-9}, **{loading: number})
                    solves += 1
                    if found.converged:
                        differences.append(difference(found.pressure, exact))
            kind, worst = f"{periodic or 'free'}, {method}", max(differences, default=np.nan)
            figures += [
                Figure(f"difference of pressures, {kind}, {solves} solves", worst, most=1e-6),
                Figure(f"not solved, and said so, {kind}", solves - len(differences), most=0),
            ]
    return figures


def plastic_contact(quick):
    """Compare with pivoting, with a hardness of each cell."""
    figures, rng = [], np.random.default_rng(7)
    for periodic in PATCHES[: 2 if quick else 3]:
        cases = []
        for k in range(1 if quick else 6):
            problem = random_problem(rng, 12, 9 - k % 2, periodic, holes=k % 2 == 1)
            approach = _approach(problem, 0.8)
            top = float(DenseProblem(problem).at(approach).max())
            cases.append((with_hardness(rng, problem, top), approach))
        for method in methods(bool(periodic)):
            differences, ratios, solves = [], [], 0
            for problem, approach in cases:
                dense = DenseProblem(problem)
                exact = dense.at(approach)
                loadings = [{"approach": approach}, {"load": problem.grid.cell_area * float(exact.sum())}]
                if np.isfinite(dense.largest_load):
                    loadings += [{"load": share * dense.largest_load} for share in (0.9, 1 - 1e-6, 1.0)]
                for loading in loadings:
                    found = solved(problem, method, options={"lcp_rtol": 1e-9}, **loading)
                    if "load" in loading:
                        exact, _ = dense.under(loading["load"], found.approach)
                    solves += 1
                    if found.converged:
                        differences.append(difference(found.pressure, exact))
                        error = dense.energy(found.pressure - exact)
                        ratios.append(error / (found.error_bound * dense.energy(found.pressure) or np.inf))
            kind, worst = f"{periodic or 'free'}, {method}", max(differences, default=np.nan)
            figures += [
                Figure(f"difference of pressures, {kind}, {solves} solves", worst, most=1e-6),
                Figure(f"largest error over its bound, {kind}", max(ratios, default=np.nan), most=1),
                Figure(f"not solved, and said so, {kind}", solves - len(differences), most=0),
            ]
    return figures


def larger_grids(quick):
    """Compare with NORM solved to 1e-10, on grids too large for a matrix."""
    figures, rng = [], np.random.default_rng(4)
    for periodic in PATCHES[:2]:
        problem = random_problem(rng, *((32, 24) if quick else (128, 96)), periodic, holes=False)
        loading = {"approach": _approach(problem, 0.5)}
        exact = solved(problem, "norm", options={"lcp_rtol": 1e-10}, **loading)
        for method in methods(bool(periodic)):
            found = solved(problem, method, options={"lcp_rtol": 1e-8}, **loading)
            off = difference(found.pressure, exact.pressure) if found.converged else np.inf
            figures.append(Figure(f"difference of pressures, {periodic or 'free'}, {method}", off, most=1e-5))
    return figures


CHECKS = (
    Check("lemke", "Lemke's method", "The exact solution in rational numbers, on up to nine cells.", lemke),
    Check("tao", "PETSc's TAO", "Minimisation under bounds, with the same product.", _by_petsc("tao")),
    Check("snesvi", "PETSc's SNESVI", "Variational inequalities, with the same product.", _by_petsc("snesvi")),
    Check("methods", "Every method by every loading", every_method.__doc__, every_method),
    Check("hardness", "Every method with a hardness", plastic_contact.__doc__, plastic_contact),
    Check("methods-larger", "Every method on larger grids", larger_grids.__doc__, larger_grids),
)  # fmt: skip
