"""Approach of a layer on a rigid base.

On a periodic patch a uniform pressure p displaces the surface of such a layer by c p. Products with A do not include
this displacement, so it is added to the solutions. A prescribed approach is found by a search over the load. The
derivative of the approach with respect to the load is at least c over the area of the patch.
"""

from dataclasses import replace
from math import log

_MAX_SOLVES = 40
_FIRST_EXPONENT = 0.5  # of the approach over the load, as for a sphere on a thin compressible layer
_SUMS = "iterations", "inner_iterations", "work_units", "operator_applications", "solve_seconds"


def add_uniform_displacement(solution, compliance):
    """Return a Solution with the uniform displacement of the layer.

    The uniform displacement is c times the mean pressure, where `compliance` is c [mm / (N/mm2)]. This is added to
    displacement and approach.
    """
    added, distance = compliance * solution.mean_pressure, solution.distance
    return replace(
        solution,
        approach=solution.approach + added,
        indentation=solution.indentation + added,
        displacement=solution.displacement + added,
        distance=lambda: distance() - added,
    )


def search_load(solve, approach, touching, tolerance, stiffness):
    """Search the load that gives an approach; return the Solution.

    Collective if ``solve(load)`` is, which returns a Solution for a load [N]. Makes secant steps of log(approach) over
    log(load) within a bracket. `approach` is above `touching`, the approach of first touch [mm]; `tolerance` is its
    largest error. `stiffness`, the area of the patch over c, bounds the load over the approach beyond first touch
    [N/mm].
    """
    target, low, high, spent = approach - touching, 0.0, stiffness * (approach - touching), []
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
    return replace(solution, approach=float(approach), prescribed="approach", **sums)
