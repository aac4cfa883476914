"""Analytic values beside those of a solution, where the problem knows them; theories of rough contact."""

from __future__ import annotations

from app.reference.base import NormalContact
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction

THEORIES = {"persson_fraction": persson_fraction, "bush_gibson_thomas_fraction": bush_gibson_thomas_fraction}
ANALYTIC = (  # what `analytic_values` knows, by the names of a Solution
    "load", "approach", "max_pressure", "contact_area", "semi_axis_major", "semi_axis_minor", "stiffness",
)  # fmt: skip


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
    if load is not None:
        reference = reference.at_load(load)
    values = (
        reference.load,
        reference.approach,
        reference.max_pressure,
        reference.contact_area,
        max(reference.a, reference.b),
        min(reference.a, reference.b),
        reference.stiffness,
    )
    return {f"analytic_{name}": value for name, value in zip(ANALYTIC, values, strict=True)}


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
