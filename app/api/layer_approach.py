"""Approach of a layer on a rigid base.

On a periodic patch a uniform pressure p displaces the surface of such a layer by c p. Products with A do not include
this displacement, so it is added to the solutions. The approach, from first touch, is the sum of the depth x, which
products with A determine, and of the compression y by the mean pressure. Both grow with the load, x only up to full
contact. A prescribed approach is found by a search on the curve of x and y. Its points are solutions with a prescribed
depth or load.

The search leaves an error d of the approach. The matrix of the layer is ``A + c/n`` with n cells. Two solutions p and
p* whose approaches differ by d obey ``||p - p*||_A^2 + c s^2 / n <= d s``, where s is the sum of p - p*. So ``||p -
p*||_A`` is at most ``d sqrt(n / c) / 2``, which is added to the error bound.
"""

from dataclasses import replace
from math import exp, log, sqrt

import numpy as np

from app.contact.loading import PrescribedApproach
from app.contact.prescribed_load import PrescribedLoad
from app.parallel.reductions import sum_over

_MAX_SOLVES = 40
_FIRST_EXPONENT = 2.0  # of the load over the depth, as for a sphere on a thin compressible layer
_ROUNDING = 1e-12
_NEWTON_STEPS = 10  # which converge quadratically, as the law is convex
_SUMS = "iterations", "inner_iterations", "work_units", "operator_applications", "solve_seconds"


def add_uniform_displacement(solution, compliance):
    """Return a Solution with the layer's uniform displacement added.

    This displacement is `compliance` [mm / (N/mm2)] times the mean pressure. It is added to displacement and approach.
    """
    added, distance = compliance * solution.mean_pressure, solution.distance
    return replace(
        solution,
        approach=solution.approach + added,
        indentation=solution.indentation + added,
        deformation=solution.deformation_plus(added),
        distance=lambda: distance() - added,
    )


def search_approach(solve, problem, distance, approach, settings):
    """Return the solution with an approach [mm], without the compression by the mean pressure.

    Collective if ``solve(loading)`` is. `distance` is the undeformed distance on the target grid. Each step is to the
    point with the prescribed approach on the power law through the last two points. It prescribes the number that
    changes less along the law, within a bracket. The error bound includes the remaining error of the approach; a
    smaller error than the tolerance is sought while the bound is too large.
    """
    grid, compliance = problem.grid, problem.kernel.uniform_compliance(problem.grid)
    target, full = approach - distance.reference, distance.full_depth
    tolerance, allowed = settings.rtol * max(target, distance.deviation), settings.error_bound
    spent, before, exponent, smallest = [], None, _FIRST_EXPONENT, np.inf
    low, high = (0.0, max(0.0, target - full)), (min(target, full), target)
    # Thin films are hardly compressed before full contact.
    film = problem.kernel.is_thin_film(grid)
    by_load, point = not film or target >= full, (high[0], low[1] if film else max(target / 2, low[1]))
    for _ in range(_MAX_SOLVES):
        if by_load:
            mean_pressure = point[1] / compliance
            solution = solve(PrescribedLoad(mean_pressure * grid.area, mean_pressure))
        else:
            solution = solve(PrescribedApproach(distance.approach_at(point[0]), point[0]))
        spent.append(solution)
        x = solution.approach - distance.reference if by_load else point[0]
        y = float(compliance * solution.mean_pressure)  # numbers of numpy do not compare as bool
        error = x + y - target
        bound = _error_bound(solution, error, compliance)
        enough = bound <= allowed or not solution.converged or 2 * abs(error) >= smallest
        if abs(error) <= tolerance and enough:
            break
        smallest = min(smallest, abs(error))
        if before is not None and min(x, y, *before) > 0 and x != before[0]:
            slope = log(y / before[1]) / log(x / before[0])
            exponent = slope if slope > 0 else exponent
        if x >= full * (1 - _ROUNDING):  # smaller loads may make full contact, too
            exponent = 1 / _ROUNDING
        before = x, y
        low, high = (before, high) if error < 0 else (low, before)
        by_load, point = _next_point(before, exponent, target, low, high)
    else:
        solution = replace(solution, converged=False, message="no load gives the approach")
    sums = {name: sum(getattr(each, name) for each in spent) for name in _SUMS}
    certificate = replace(solution.certificate, error_bound=bound)
    approach -= compliance * solution.mean_pressure
    solution = replace(solution, **sums, approach=approach, prescribed="approach", certificate=certificate)
    if not solution.converged or bound <= allowed:
        return solution
    message = f"the pressure is proved to {bound:.2g} only at the prescribed approach (-lcp_error_bound {allowed:g})"
    return replace(solution, converged=False, message=f"{solution.message}, but {message}")


def _next_point(last, exponent, target, low, high):
    """Return whether the next step prescribes the load, and its depth and compression [mm]."""
    by_load, point = low[1] > 0, low
    if min(last) > 0:
        a, b = 1 / max(1, exponent), min(1, exponent)
        s = min(log(target / last[0]) / a, log(target / last[1]) / b)  # where one number is the target
        for _ in range(_NEWTON_STEPS):
            point = last[0] * exp(a * s), last[1] * exp(b * s)
            s -= (sum(point) - target) / (a * point[0] + b * point[1])
        by_load = point[0] < exponent * point[1]
    if not low[by_load] < point[by_load] < high[by_load]:
        least, most = low[by_load], high[by_load]
        point = 2 * (sqrt(least * most) if least > 0 else most / 10,)
    return by_load, point


def _error_bound(solution, error, compliance):
    """Return the error bound of a solution whose approach has an `error` [mm]. Collective."""
    [energy] = sum_over(solution.comm, [(solution.pressure * solution.displacement).sum()])
    added = abs(error) * np.sqrt(solution.grid.n / compliance) / 2
    return solution.certificate.error_bound + (float(added / np.sqrt(energy)) if energy > 0 else 0.0)
