"""Studies beyond the paper's tables, with other random surfaces."""

import itertools

import numpy as np

from app.paper.item import CASES, Item, solver_run
from app.paper.tables import counts, inexact_counts

SEEDS = (1, 2, 3, 4, 5, 6, 8, 9, 10, 11)  # Seeds of the surfaces; the tables use 7.
SEED_SIZES = (64, 256)
INEXACT = (5, 4, 3, 2)  # numbers of CG iterations


def quantiles(values):
    """Return ``[min, median, max]`` of the numbers that are not None.

    Return None if there are no numbers.
    """
    values = [value for value in values if value is not None]
    return [round(float(f(values)), 4) for f in (min, np.median, max)] if values else None


def _plan_seeds(limits):
    methods = {"V11": "fmg_v11", "norm_cg": "norm"}
    return {
        (str(case), str(n), name, str(seed)): solver_run(
            "punch", method, n, approach=CASES[case], surface_seed=seed
        )
        for case in CASES
        for n in limits.sizes(*SEED_SIZES)
        for name, method in methods.items()
        for seed in SEEDS[: limits.seeds]
    }


def _evaluate_seeds(outcomes):
    rows = []
    for (case, n, method), group in itertools.groupby(outcomes.items(), key=lambda item: item[0][:3]):
        runs = [outcome for _, outcome in group]
        pairs = [counts(o, "inner_iterations" if method == "norm_cg" else "work_units") for o in runs]
        solved = [pair for pair in pairs if pair]
        rows.append({
            "case": int(case),
            "grid": int(n),
            "method": method,
            "surfaces": len(runs),
            "not_solved": len(runs) - len(solved),
            "contact": quantiles([outcome["contact_fraction"] for outcome in runs]),
            "iterations": quantiles([pair[0] for pair in solved]),
            "work_units": quantiles([pair[1] for pair in solved]),
        })  # fmt: skip
    return {"rows": rows}


def _plan_inexact(limits):
    n = min(256, limits.largest)
    return {
        (str(k), str(seed)): solver_run(
            "punch", "norm", n, approach=CASES[3], ksp_max_it=k, surface_seed=seed
        )
        for k in INEXACT
        for seed in SEEDS[: limits.seeds]
    }


def _evaluate_inexact(outcomes):
    rows = []
    for k, group in itertools.groupby(outcomes.items(), key=lambda item: item[0][0]):
        pairs = [inexact_counts(outcome, int(k)) for _, outcome in group]
        solved = [pair for pair in pairs if pair]
        rows.append({
            "cg_iterations": int(k),
            "surfaces": len(pairs),
            "not_solved": len(pairs) - len(solved),
            "iterations": quantiles([pair[0] for pair in solved]),
            "work_units": quantiles([pair[1] for pair in solved]),
        })  # fmt: skip
    return {"rows": rows}


STUDIES = [
    Item("seeds", "study", "Other random surfaces: full multigrid V(1,1), and active set + CG",
         _plan_seeds, _evaluate_seeds,
         note="Same approaches, so the contact share varies with the surface. Work units of CG are its iterations."),
    Item("inexact", "study", "Other random surfaces, case 3: few CG iterations for each contact set",
         _plan_inexact, _evaluate_inexact,
         note="Largest grid of Table 8, where the paper reports divergence for 4 iterations. Not solved means: not "
              "within 100 active set iterations."),
]  # fmt: skip
