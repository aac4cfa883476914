"""Analytic values and theories to compare a solution with."""

import numpy as np

from app.reference.base import NormalContact
from app.reference.rough import bush_gibson_thomas_fraction, persson_fraction, persson_hardness_fractions

THEORIES = (  # contact fractions of rough surfaces; the last two only with a hardness
    "persson_fraction", "bush_gibson_thomas_fraction", "persson_hardness_fraction", "persson_plastic_fraction",
)  # fmt: skip
ANALYTIC = (  # names of a Solution's numbers that have analytic values
    "load", "approach", "max_pressure", "contact_area", "semi_axis_major", "semi_axis_minor", "stiffness",
)  # fmt: skip


def analytic_values(problem, measures, approach, loading):
    """Return values of the problem's analytic solution, named ``analytic_NAME``.

    The values are for the approach [mm], or for the load if it is prescribed. The dict is empty if there is no analytic
    solution or no load, if there are plastic cells, or if the bodies are tilted.
    """
    if not measures.load > 0 or measures.plastic_area or loading.is_tilted:
        return {}
    reference = problem.reference(approach)
    if not isinstance(reference, NormalContact) or reference.a == 0:
        return {}
    if loading.load is not None:
        reference = reference.at_load(loading.load)
    axes = {
        "semi_axis_major": max(reference.a, reference.b),
        "semi_axis_minor": min(reference.a, reference.b),
    }
    return {f"analytic_{name}": axes[name] if name in axes else getattr(reference, name) for name in ANALYTIC}


def theories(problem, mean_pressure, rms_slope):
    """Return the contact fractions that rough-surface `THEORIES` predict.

    `mean_pressure` is the load over the area of the patch [N/mm2], `rms_slope` the slope of the undeformed distance.
    The dict is empty unless the bodies are nominally flat, rough half-spaces that are not indented, and the
    hardness is no array.
    """
    if not problem.material.is_half_space or np.any(problem.surface_compliance):
        return {}
    scale, hardness = problem.material.contact_modulus * rms_slope, problem.hardness
    if problem.name != "rough" or not scale > 0 or np.ndim(hardness) or problem.indentation is not None:
        return {}
    relative = mean_pressure / scale
    fractions = [persson_fraction(relative), bush_gibson_thomas_fraction(relative)]
    if hardness is not None:
        opened, _, plastic = persson_hardness_fractions(relative, hardness / scale)
        fractions += [1 - opened, plastic]
    return {name: float(fraction) for name, fraction in zip(THEORIES, fractions, strict=False)}
