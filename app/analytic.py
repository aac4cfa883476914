"""Analytic values beside those of a solution, where the problem knows them."""

from __future__ import annotations

from app.reference.base import NormalContact


def analytic_values(problem, approach, load=None):
    """Numbers of the analytic solution: ``analytic_NAME`` for NAMEs of a Solution.

    Not collective.

    Parameters
    ----------
    problem : Problem
    approach : float
        [mm]
    load : float, optional
        If that is prescribed [N]: then the analytic approach belongs to it.

    Returns
    -------
    dict
        Empty if there is none, or no contact.
    """
    reference = problem.reference(approach)
    if not isinstance(reference, NormalContact) or reference.a == 0:
        return {}
    if load:
        reference = reference.at_load(load)
    return {
        "analytic_load": reference.load,
        "analytic_approach": reference.approach,
        "analytic_max_pressure": reference.max_pressure,
        "analytic_contact_area": reference.contact_area,
        "analytic_semi_axis_major": max(reference.a, reference.b),
        "analytic_semi_axis_minor": min(reference.a, reference.b),
        "analytic_stiffness": reference.stiffness,
    }
