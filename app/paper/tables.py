"""Tables 1 to 8 of the paper: runs, and counts of work."""

import json
from functools import partial
from pathlib import Path

from app.paper import trace
from app.paper.item import CASES, Item, nest, plan_grids, solver_run

PAPER = json.loads(Path(__file__).with_name("paper_tables.json").read_text(encoding="utf-8"))
SIZES = (32, 64, 128, 256)
OMEGAS = ("0.8", "1.0", "1.1")
CG_ITERATIONS = (20, 15, 10, 5, 4)
CYCLES = ("V11", "V10", "V01")
HEADINGS = {"V11": "V(1,1)", "V10": "V(1,0)", "V01": "V(0,1)", "norm_cg": "active set + CG"}
# Options to solve the first contact set's system only: one active set iteration whose KSP repeats the cycle. The
# relative tolerance of the KSP is the test over the unknowns of that system.
_FIRST = {
    "lcp_max_it": 1, "ksp_type": "richardson", "ksp_norm_type": "unpreconditioned", "ksp_rtol": 1e-6,
    "ksp_atol": 0, "ksp_max_it": 100, "pc_type": "mg",
}  # fmt: skip


def converged(outcome):
    """Return whether a run or a trace converged."""
    return outcome["exit_status"] == 0


def counts(outcome, work="work_units"):
    """Return ``[active set iterations, work units]``; None unless converged."""
    if not converged(outcome):
        return None
    return [outcome["active_set_iterations"], round(outcome[work], 1)]


def _plan_table1(largest):
    def first(n, omega):
        return trace.traced("hertz", None, n, trace.collect_cycles, mg_levels_pc_sor_omega=omega, **_FIRST)

    return plan_grids(largest, (64, 128), {omega: omega for omega in OMEGAS}, first)


def _cycles(outcome):
    residuals = outcome["linear_residuals"]
    if not residuals[-1] <= 1e-6 * residuals[0]:
        return None
    m = len(residuals) - 1
    return [m, round((residuals[-1] / residuals[0]) ** (1 / m), 3)]


def plan_methods(problem, prefix, norm, largest, **options):
    """Return runs of a problem with the three cycles, on several grids.

    The name of a method file is `prefix` and the cycle, such as v11. If `norm` is true, NORM runs, too.
    """
    methods = {cycle: f"{prefix}_{cycle.lower()}" for cycle in CYCLES} | ({"norm_cg": "norm"} if norm else {})
    return plan_grids(largest, SIZES, methods, lambda n, method: solver_run(problem, method, n, **options))


def evaluate_methods(outcomes):
    """Return the `counts` of the runs of `plan_methods`, by grid and method.

    The work units of NORM are its CG iterations.
    """
    return nest({
        case: counts(outcome, "inner_iterations" if case[1] == "norm_cg" else "work_units")
        for case, outcome in outcomes.items()
    })  # fmt: skip


def _plan_table4(largest):
    def errors(n, rtol):
        return trace.traced("hertz", "fmg_v11", n, trace.collect_errors, lcp_rtol=rtol)

    return plan_grids(largest, (8, 16, *SIZES), {"errors": None, "discrete": 1e-10}, errors)


def _evaluate_table4(outcomes):
    data = {}
    for (size, what), outcome in outcomes.items():
        errors = [round(error, 2) for error in outcome["errors"]]
        numbers = errors[-1] if what == "discrete" else errors
        data[size, what] = numbers if converged(outcome) else None
    return nest(data)


def _plan_table8(largest):
    def inexact(n, k):
        return solver_run("punch", "norm", n, approach=CASES[3], ksp_max_it=k)

    return plan_grids(largest, SIZES, {str(k): k for k in CG_ITERATIONS}, inexact)


def inexact_counts(outcome, k):
    """Return active set iterations and work units (Table 8).

    An active set iteration costs k CG iterations, the defect and the displacement: k + 2 work units.
    """
    pair = counts(outcome)
    return pair and [pair[0], pair[0] * (k + 2)]


def _evaluate_table8(outcomes):
    return nest({case: inexact_counts(outcome, int(case[1])) for case, outcome in outcomes.items()})


_SURFACE = (
    "The paper does not give the numbers of its random surface: ours is another one with the same parameters."
)
_CASE_TITLE = "Rough punch, case {}: approach {} mm, full multigrid"

TABLES = [
    Item("table1", "table", "Hertz, first contact set only: V(1,1) cycles for (5.1), and convergence factor",
         _plan_table1, lambda outcomes: nest({case: _cycles(outcome) for case, outcome in outcomes.items()}),
         note="Both norms of (5.1) are taken over the unknowns of this system, the cells of the first contact set. "
              "With h on the whole patch the test is a fifth looser: 8 instead of 9 cycles for ω = 0.8."),
    Item("table2", "table", "Hertz, multigrid + active set: active set iterations, and work units",
         partial(plan_methods, "hertz", "mg", True), evaluate_methods),
    Item("table3", "table", "Hertz, full multigrid: active set iterations on the target grid, and work units",
         partial(plan_methods, "hertz", "fmg", False), evaluate_methods,
         note="A cell that enters or leaves the contact set late costs an iteration; the paper leaves details of the "
              "interpolation open that decide about single cells."),
    Item("table4", "table", "Hertz, full multigrid with V(1,1): rms pressure error on the contact area [N/mm²]",
         _plan_table4, _evaluate_table4,
         note="Root mean square over the cells of the converged contact area. "
              "Nearly all of the error sits in its outermost cells; which cells these are decides."),
    *(Item(f"table{4 + case}", "table", _CASE_TITLE.format(case, approach.replace("-", "−")),
           partial(plan_methods, "punch", "fmg", True, approach=approach), evaluate_methods, note=_SURFACE)
      for case, approach in CASES.items()),
    Item("table8", "table", "Rough punch, case 3: a fixed number of CG iterations for each contact set",
         _plan_table8, _evaluate_table8,
         note=f"Work units: active set iterations times CG iterations plus two. {_SURFACE}"),
]  # fmt: skip
