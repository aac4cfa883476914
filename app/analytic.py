"""Analytic values beside those of a solution, where the problem knows them; theories of rough contact."""

from __future__ import annotations

from app.reference.base import NormalContact
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction

THEORIES = {"persson_fraction": persson_fraction, "bush_gibson_thomas_fraction": bush_gibson_thomas_fraction}


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


def theories(problem, mean_pressure, rms_slope):
    """Contact fractions of `THEORIES`, where nominally flat bodies are rough: surfaces on a plane.

    Not collective.

    Parameters
    ----------
    problem : Problem
    mean_pressure : float
        [N/mm2]
    rms_slope : float

    Returns
    -------
    dict
        Empty for other bodies.
    """
    scale = problem.material.contact_modulus * rms_slope
    if problem.name != "rough" or not scale > 0:
        return {}
    return {name: float(theory(mean_pressure / scale)) for name, theory in THEORIES.items()}
