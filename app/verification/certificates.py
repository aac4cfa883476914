"""Checks that the error bound holds and is sharp."""

import numpy as np

from app.contact.certificate import certify
from app.contact.distance import UndeformedDistance
from app.contact.periodic_state import contact_state
from app.halfspace.operator import InfluenceOperator
from app.verification.check import Check, Figure
from app.verification.dense import DenseProblem
from app.verification.solving import approach_at, patch_name, patches, random_problem, solved

_DEPTHS = 0.2, 0.7, 0.95  # Approaches between first touch and the mean gap, as shares of this way.
_TOLERANCES = 1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 1e-15
_METHODS = None, "norm", "fmg_v11"
_MIN_RATIO = 0.1  # Least ratio of error to bound where rounding is negligible.


def errors_of_answers(quick):
    """Yield true relative errors in the energy norm, and their bounds.

    Each item is a kind of patch, and a dict that maps a tolerance to errors and bounds.
    """
    rng = np.random.default_rng(5)
    for periodic in patches(quick):
        pairs = {rtol: [] for rtol in _TOLERANCES}
        for k in range(1 if quick else 8):
            problem = random_problem(rng, *rng.choice([10, 12, 16], 2), periodic)
            dense, approach = DenseProblem(problem), approach_at(problem, _DEPTHS[k % 3])
            exact = dense.at(approach)
            load = problem.grid.cell_area * float(exact.sum())
            for rtol in _TOLERANCES:
                for method in _METHODS:
                    for loading in ({"approach": approach}, {"load": load}):
                        options = {"lcp_rtol": rtol, "lcp_error_bound": 0.99}
                        found = solved(problem, method, options=options, **loading)
                        if size := dense.energy(found.pressure):
                            error = dense.energy(found.pressure - exact) / size
                            pairs[rtol].append((error, found.error_bound))
        yield patch_name(periodic), {rtol: np.array(of).T for rtol, of in pairs.items()}


def of_answers(quick):
    """Compare solutions' error bounds with true errors.

    The exact solutions come from pivoting in extended precision.
    """
    figures = []
    for kind, pairs in errors_of_answers(quick):
        figures += _ratios(kind, "answers", *np.hstack(list(pairs.values())), large=1e-6)
        for rtol, (error, bound) in pairs.items():
            middle, high = np.quantile(error / bound, (0.5, 0.9))
            figures += [
                Figure(f"largest error, {kind}, rtol {rtol:g}", error.max()),
                Figure(f"its bound, {kind}, rtol {rtol:g}", bound.max()),
                Figure(f"error over bound, median, {kind}, rtol {rtol:g}", middle),
                Figure(f"error over bound, 90% quantile, {kind}, rtol {rtol:g}", high),
            ]
    return figures


def of_anything(quick):
    """Compare the error bounds of disturbed pressures with their true errors.

    The noise is up to ten times as large as the largest pressure.
    """
    figures, rng = [], np.random.default_rng(6)
    for periodic in patches(quick):
        true, bounds = [], []
        for _ in range(3 if quick else 20):
            problem = random_problem(rng, 12, 10, periodic)
            dense, approach = DenseProblem(problem), approach_at(problem, 0.7)
            exact = dense.at(approach).astype(float)
            operator = InfluenceOperator(problem.grid, problem.kernel)
            state = contact_state(operator, UndeformedDistance(operator, problem.gap))
            state.approach = approach
            for size in (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 10.0):
                noise = size * exact.max() * rng.normal(size=exact.shape)
                kept = state.admissible & (rng.random(exact.shape) > 0.02 * (size > 0))
                state.values[...] = np.where(kept, exact + noise, 0)
                state.project()
                state.compute_displacement()
                bounds.append(certify(state).error_bound)
                true.append(dense.energy(state.p - dense.at(approach)) / dense.energy(state.p))
        figures += _ratios(patch_name(periodic), "pressures", np.array(true), np.array(bounds), large=0.1)
    return figures


def _ratios(kind, things, true, bounds, large):
    """Check the largest and the smallest ratio of error to bound.

    Return a `Figure` for each. The largest ratio must be at most 1. Among errors above `large`, the smallest ratio must
    be at least `_MIN_RATIO`.
    """
    ratios = true / bounds
    sharp = ratios[true > large]
    largest, smallest = "largest error over its bound", f"smallest one of an error above {large:g}"
    return [
        Figure(f"{largest}, {kind}, {ratios.size} {things}", ratios.max(), 0, 1, (true, bounds)),
        Figure(f"{smallest}, {kind}, {sharp.size} {things}", sharp.min(), _MIN_RATIO),
    ]


_LAW = "`error_bound` is never below the true error, and not many times above it."
CHECKS = (
    Check("certificate", "Answers at every tolerance", _LAW, of_answers),
    Check("certificate-any", "Pressures that no solver has made", "It bounds the error of any pressure.", of_anything),
)  # fmt: skip
