"""Check that any number of ranks gives the same answer.

``mpiexec -n 2 python -m app.verification.ranks OUT.npz`` writes the answers of two ranks.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from app.base.mpi import MPI
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.parameter_study.processes import run_command
from app.problems.contact_problem import ContactProblem
from app.problems.random_surfaces import SelfAffineSurface
from app.problems.shapes import Paraboloid
from app.verification.check import Check, Figure
from app.verification.solving import difference, solved

_STEEL = Material.combined(82000.0, 0.28)
_SINGLE = 2e-4  # Difference that the tolerance of 1e-6 allows, over the largest pressure.
_WAYS = {
    "fast": ("fast", {}, _SINGLE),
    "fast, -lcp_precision double": ("fast", {"lcp_precision": "double"}, 1e-9),
    "fast, -lcp_rtol 1e-10": ("fast", {"lcp_rtol": 1e-10}, 1e-7),
    "fmg_v11": ("fmg_v11", {}, 1e-9),
    "norm, -lcp_rtol 1e-10": ("norm", {"lcp_rtol": 1e-10}, 1e-7),
    "primal": ("primal", {}, _SINGLE),
    "primal, -lcp_precision double": ("primal", {"lcp_precision": "double"}, 1e-9),
}


def _problems(quick, periodic):
    """Return problems and mean pressures [N/mm2], by name."""
    n = 40 if quick else 96
    grid = Grid.from_domain(n, n, (0.0, 1.0, 0.0, 1.0))
    surface = SelfAffineSurface(0.8, 0.25, 1 / 16, (1.0, 1.0), 3, rms_slope=0.1)
    height = surface.height(grid.x(), grid.y())
    rough = ContactProblem(grid, _STEEL, height.max() - height, periodic=periodic)
    problems = {f"rough {n}²": (rough, 0.03 * _STEEL.contact_modulus)}
    if not periodic:
        patch = Grid.from_domain(n, n, (-10.0, 10.0, -6.0, 6.0))
        problems[f"Hertz {n}²"] = ContactProblem(patch, _STEEL, Paraboloid(300.0, 163.0)), 340.0
    return problems


def solve_all(quick, comm):
    """Return the pressure and contact set of each case, on rank 0.

    Collective over `comm`.
    """
    arrays = {}
    for way, (method, options, _) in _WAYS.items():
        if quick and "rtol" in way:
            continue
        for name, (problem, mean_pressure) in _problems(quick, method == "primal").items():
            # Few cells on a rank, so that several grids are shared
            more = {"lcp_cells_per_rank": 64, **options}
            by_load = solved(problem, method, comm, options=more, mean_pressure=mean_pressure)
            by_approach = solved(problem, method, comm, options=more, approach=by_load.approach)
            for loading, solution in (("load", by_load), ("approach", by_approach)):
                whole = solution.gather()
                if whole is not None:
                    case = f"{way}|{name}, by {loading}"
                    arrays[f"{case}|pressure"], arrays[f"{case}|contact"] = whole.pressure, whole.contact
                    arrays[f"{case}|facts"] = np.array([solution.converged, solution.iterations])
    return arrays


def on_ranks(quick):
    """Compare the solutions on two and three ranks with those on one."""
    answers = {1: solve_all(quick, MPI.COMM_SELF)}
    with tempfile.TemporaryDirectory() as folder:
        for ranks in (2,) if quick else (2, 3):
            target = Path(folder) / f"{ranks}.npz"
            command = ["mpiexec", "-n", str(ranks), sys.executable, "-m", __spec__.name, str(target)]
            status, errors = run_command([*command, "quick"] if quick else command, timeout=600)
            if status:
                return [Figure(f"exit status of {ranks} ranks: {errors.strip()[-300:]}", status, 0, 0)]
            with np.load(target) as data:
                answers[ranks] = dict(data)
    return compare(answers)


def compare(answers):
    """Return figures comparing several ranks' answers with one rank's.

    `answers` maps numbers of ranks to results of `solve_all`.
    """
    one, several, figures = answers[1], [of for ranks, of in answers.items() if ranks > 1], []
    for way, (*_, limit) in _WAYS.items():
        cases = {name.rpartition("|")[0] for name in one if name.startswith(f"{way}|")}
        if not cases:
            continue
        pairs = [(other, case) for case in cases for other in several]
        off = max(difference(other[f"{c}|pressure"], one[f"{c}|pressure"]) for other, c in pairs)
        cells = max(int((other[f"{c}|contact"] != one[f"{c}|contact"]).sum()) for other, c in pairs)
        solved_all = all(of[f"{c}|facts"][0] for c in cases for of in answers.values())
        its = max(abs(other[f"{c}|facts"][1] - one[f"{c}|facts"][1]) for c in cases for other in several)
        figures += [
            Figure(f"difference of pressures, {way}", off if solved_all else np.nan, most=limit),
            Figure(f"cells whose contact differs, {way}", cells),
            Figure(f"difference of iterations on the target grid, {way}", int(its)),
        ]
    return figures


_LAW = """\
Contact sets, counts and pressures are the same, in double precision up to round-off. With single precision inside, the
default, pressures agree within the tolerance (`-lcp_rtol` 1e-6): to some 1e-5 of the largest."""
CHECKS = (Check("ranks", "One, two and three ranks", _LAW, on_ranks),)

if __name__ == "__main__":
    made = solve_all("quick" in sys.argv[2:], MPI.COMM_WORLD)
    if MPI.COMM_WORLD.rank == 0:
        np.savez(sys.argv[1], **made)
