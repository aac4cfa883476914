"""Analytic values and theories to compare a solution with."""

from app.reference.base import NormalContact
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction

THEORIES = {"persson_fraction": persson_fraction, "bush_gibson_thomas_fraction": bush_gibson_thomas_fraction}
ANALYTIC = (  # names of a Solution's numbers that have analytic values
    "load", "approach", "max_pressure", "contact_area", "semi_axis_major", "semi_axis_minor", "stiffness",
)  # fmt: skip


def analytic_values(problem, approach, load=None):
    """Return numbers of the analytic solution, ``analytic_NAME``.

    Parameters
    ----------
    problem : Problem
    approach : float
        [mm]
    load : float, optional
        Prescribed load [N]; the analytic approach belongs to it.

    Returns
    -------
    dict
        Empty without an analytic solution or contact.
    """
    reference = problem.reference(approach)
    if not isinstance(reference, NormalContact) or reference.a == 0:
        return {}
    if load is not None:
        reference = reference.at_load(load)
    axes = {
        "semi_axis_major": max(reference.a, reference.b),
        "semi_axis_minor": min(reference.a, reference.b),
    }
    return {f"analytic_{name}": axes[name] if name in axes else getattr(reference, name) for name in ANALYTIC}


def theories(problem, mean_pressure, rms_slope):
    """Return contact fractions of `THEORIES` for nominally flat surfaces.

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
