"""Approach of a layer on a rigid base.

On a periodic patch a uniform pressure p displaces the surface of such a layer by c p. Products with A do not include
this displacement, so it is added to the solutions. A prescribed approach is found by a search over the load. The
derivative of the approach with respect to the load is at least c over the area of the patch.

The search leaves an error d of the approach. The matrix of the layer is ``A + c/n`` with n cells. Two solutions p and
p* whose approaches differ by d obey ``||p - p*||_A^2 + c s^2 / n <= d s``, where s is the sum of p - p*. So ``||p -
p*||_A`` is at most ``d sqrt(n / c) / 2``, which is added to the error bound.
"""

from dataclasses import replace
from math import log

import numpy as np

from app.parallel.reductions import sum_over

_MAX_SOLVES = 40
_FIRST_EXPONENT = 0.5  # of the approach over the load, as for a sphere on a thin compressible layer
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
        displacement=solution.displacement + added,
        distance=lambda: distance() - added,
    )


def _add_approach_error(solution, approach, compliance, allowed):
    """Return the Solution with the prescribed approach; increase its error bound.

    Collective. The error bound includes the effect of the error of the approach. If the bound exceeds `allowed`, the
    solution has not converged.
    """
    error, p, certificate = abs(solution.approach - approach), solution.pressure, solution.certificate
    [energy] = sum_over(
        solution.comm, [(p * (solution.displacement - compliance * solution.mean_pressure)).sum()]
    )
    added = error * np.sqrt(solution.grid.n / compliance) / 2
    bound = certificate.error_bound + (float(added / np.sqrt(energy)) if energy > 0 else 0.0)
    solution = replace(
        solution,
        approach=float(approach),
        prescribed="approach",
        certificate=replace(certificate, error_bound=bound),
    )
    if not solution.converged or bound <= allowed:
        return solution
    message = f"the pressure is proved to {bound:.2g} only at the prescribed approach (-lcp_error_bound {allowed:g})"
    return replace(solution, converged=False, message=f"{solution.message}, but {message}")


def search_load(solve, approach, touching, tolerance, area, compliance, allowed):
    """Search the load that nearly gives an approach; return its Solution.

    Collective if ``solve(load)`` is, which returns a Solution for a load [N]. Makes secant steps of log(approach) over
    log(load) within a bracket. `approach` is above `touching`, the approach of first touch [mm]; `tolerance` is its
    largest error. `area` is the area of the patch [mm2], `compliance` is the displacement by a uniform pressure 1 [mm /
    (N/mm2)]. `allowed` is the largest accepted error bound.
    """
    target, spent = approach - touching, []
    low, high = 0.0, target * area / compliance  # a compression by the mean pressure alone
    load, exponent, before = high / 2, _FIRST_EXPONENT, None
    for _ in range(_MAX_SOLVES):
        solution = solve(load)
        spent.append(solution)
        reached = max(solution.approach - touching, tolerance)
        if abs(reached - target) <= tolerance:
            break
        low, high = (load, high) if reached < target else (low, load)
        if before is not None and (slope := log(reached / before[1]) / log(load / before[0])) > 0:
            exponent = slope
        before, step = (load, reached), load * (target / reached) ** (1 / exponent)
        load = step if low < step < high else (low + high) / 2 if low else high / 10
    else:
        solution = replace(solution, converged=False, message="no load gives the approach")
    sums = {name: sum(getattr(each, name) for each in spent) for name in _SUMS}
    return _add_approach_error(replace(solution, **sums), approach, compliance, allowed)
