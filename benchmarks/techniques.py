"""Count work without each technique, and with each constant halved and doubled.

    python -m benchmarks.techniques              # free patches, 512 x 512 (three minutes)
    python -m benchmarks.techniques --periodic   # periodic ones, 512 x 512 (a minute)

Prints the tables of docs/notebook/performance.md: geometric means of operator applications.
Counts do not depend on the load of the machine.
"""

import argparse
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from tqdm import tqdm

from app import ContactProblem, ContactSolver, FlatPunch, Grid, Material, Paraboloid
from app.io.table import format_markdown
from app.options.method import read_method_file
from app.problems.random_surfaces import WavySurface
from benchmarks.loads import MATERIAL, SIDE, SLOPE, Spectrum

FORCE = MATERIAL.contact_modulus * SLOPE * SIDE**2
# Contact on 1% to 99% of the cells; and on 0.2%, 5%, 35%, 88%.
APPROACHES = (0.00187, 0.0113, 0.0202, 0.037, 0.0899, 0.1768)
LOADS = (0.0005, 0.02, 0.2, 1.0)

TECHNIQUES = {
    "defect correction": {"lcp_defect_correction": 0},
    "lift": {"lcp_prolongation": "copy"},
    "predictor": {"lcp_predictor": 0},
    "block means": {"pc_circulant_blocks": 0},
    "edge extension, block means and predictor": {
        "pc_circulant_extend": 0,
        "pc_circulant_blocks": 0,
        "lcp_predictor": 0,
    },
    "loose coarse grids": {"lcp_coarse_rtol": 1e-6},
    "windows": {"lcp_window": 0},
    "single precision": {"lcp_precision": "double"},
}


@dataclass(frozen=True)
class Constant:
    """Constant of a module of app/, or option of a method."""

    name: str
    meaning: str
    module: str = ""

    def value(self, method):
        """Return the current value."""
        if self.module:
            return getattr(import_module(self.module), self.name)
        return float(read_method_file(method)[self.name])

    def count(self, count, value):
        """Return the result of ``count(options)`` with another value."""
        if not self.module:
            return count({self.name: value})
        module, before = import_module(self.module), self.value(None)
        setattr(module, self.name, value)
        try:
            return count({})
        finally:
            setattr(module, self.name, before)

    def __str__(self):
        return f"`{self.name}`" if self.module else f"`-{self.name}`"


_LOAD = "app.contact.prescribed_load"
_FAST = "app.methods.free.iteration"
_PRIMAL = "app.methods.periodic.iteration"
_BLOCKS = "app.methods.free.block_average"
_TWO_GRID = "app.methods.periodic.two_grid"
_STATE = "app.methods.periodic.state"
FREE = (
    Constant("ksp_rtol", "relative residual to which each contact set is solved"),
    Constant("lcp_coarse_rtol", "residual over h on C at which a coarse grid is left"),
    Constant("lcp_window", "margin of a window, as a share of the extent of contact"),
    Constant("lcp_predictor", "share of the predicted change of u that is used"),
    Constant("pc_circulant_extend", "steps of the extension past the contact edge, one cell each"),
    Constant("pc_circulant_blocks", "cells along a side of a block, whose mean residual starts the extension"),
    Constant("CONTACT_SHARE_OFFSET", "share of contact around a cell below which the cell counts less", _BLOCKS),
    Constant("MIN_SCATTERED_FRACTION", "share of blocks in partial contact from which on block means are used",
        _BLOCKS),
    Constant("lcp_defect_correction", "share of a residual that is left to the next exact product"),
    Constant("IN_CONTACT", "factor on the tolerance of (5.1) with h on C only", "app.methods.stopping"),
    Constant("MAX_RELEASED_SHARE", "share of the load that a coarse grid releases without a product", _FAST),
    Constant("MAX_COARSE_LOAD_MISS", "largest error of the approach on a coarse grid, in tolerances", _FAST),
    Constant("MIN_SINGLE_RESIDUAL", "residual over h on C below which single precision is noise", _FAST),
    Constant("MIN_LOAD_FRACTION", "share of the largest load since u was computed; u is recomputed below it", _FAST),
    Constant("PATIENCE", "iterations without halving the residual before the safeguard starts", "app.methods.progress"),
    Constant("MIN_SECANT_STEP", "smallest move of the approach for a secant, in rms residuals", _LOAD),
    Constant("MAX_SLOPE_RATIO", "largest factor by which the slope may change in one step", _LOAD),
    Constant("MIN_MEAN_SLOPE_FRACTION", "smallest slope of a secant, over the mean slope since first touch", _LOAD),
    Constant("LOAD_RESIDUAL_FRACTION", "error of the approach that is tolerated, over the rms residual", _LOAD),
    Constant("MAX_LOAD_RATIO", "ratio of the loads above which p is copied instead of lifted", "app.methods.free.lift"),
    Constant("MIN_MARGIN", "smallest margin of a window, in cells", "app.methods.free.windows"),
    Constant("MAX_WINDOW_FRACTION", "largest window, as a share of the cells", "app.methods.free.windows"),
    Constant("MAX_EXCLUDED_PRESSURE", "smallest pressure of a cell with a gap, over the largest",
        "app.methods.safeguard"),
)  # fmt: skip
PERIODIC = (
    Constant("MAX_CHANGED_FRACTION", "share of the cells that may still change on a coarse grid", _PRIMAL),
    Constant("NEGLIGIBLE_OVERLAP", "largest overlap that is ignored, over the error aimed at", _PRIMAL),
    Constant("MAX_GAP_CHANGE", "largest change of a gap that needs no other contact set, over the error aimed at",
        _PRIMAL),
    Constant("AIM_FRACTION", "preconditioned residual aimed at, over the allowed residual", _PRIMAL),
    Constant("FAILED_AIM_FRACTION", "residual aimed at after a failed verification, over what it asks for", _PRIMAL),
    Constant("MAX_MULTILEVEL_ERROR", "error of the multilevel product at a verification, over the error aimed at",
        _PRIMAL),
    Constant("MAX_ERROR_RATIO", "error over residual above which p is recomputed", _PRIMAL),
    Constant("NO_PRESSURE_AIM_FRACTION", "reduction of the residual if the load is less than the pressure left free",
        _PRIMAL),
    Constant("GUESS_SWEEPS", "projected sweeps that guess the first contact set of a grid",
        "app.methods.periodic.solver"),
    Constant("CLOSING_DAMPING", "damping of the residual that is added when captured gaps are closed", _STATE),
    Constant("CONSTANT_COMPLIANCE", "compliance of a constant times E*, over the spacing of contact", _TWO_GRID),
    Constant("CONTACT_STIFFNESS", "reduction of long waves near contact, over the share of contact there", _TWO_GRID),
    Constant("LONG_WAVE_LEVELS", "grids between a grid and the grid of its long waves", "app.methods.periodic.solver"),
    Constant("ksp_rtol", "relative residual to which each contact set is solved"),
    Constant("lcp_coarse_rtol", "residual at which a coarse grid is left"),
    Constant("lcp_defect_correction", "share of a residual that is left to the next exact product"),
    Constant("pc_two_grid_sweeps", "sweeps after the coarse-grid correction"),
)  # fmt: skip


def free_problems(n):
    """Return problems with their loadings, by approach and by load."""

    def rectangle(a, b):
        return Grid.from_domain(n, n, (-a, a, -b, b))

    waves = WavySurface((12, 10), 0.8, 0.1, 7, (12.0, 10.0), (-6.0, -5.0))
    punch = ContactProblem(
        rectangle(6.0, 5.0), Material.combined(80000.0, 0.28), FlatPunch(8.97), surfaces=[waves]
    )
    hertz = ContactProblem(rectangle(10.0, 6.0), Material.combined(82000.0, 0.28), Paraboloid(300.0, 163.0))
    rough = [
        _self_affine(n, Spectrum(0.8, SIDE / 4, shortest=SIDE / 32)),
        *(_self_affine(n, Spectrum(0.8, SIDE / 8, cells=cells)) for cells in (4, 8)),
    ]
    by_approach = [(hertz, (0.1091,)), (punch, (-0.11, 0.01, 0.25)), (rough[0], (0.012,))]
    by_approach += [(problem, APPROACHES) for problem in rough[1:]]
    by_load = [(problem, [load * FORCE for load in LOADS]) for problem in rough[1:]]
    return {"approach": by_approach, "load": by_load}


def _unit(n):
    return Grid.from_domain(n, n, (0.0, SIDE, 0.0, SIDE))


def _self_affine(n, spectrum):
    height = spectrum.height(_unit(n), seed=1)
    return ContactProblem(_unit(n), MATERIAL, height.max() - height)


def periodic_problems(n):
    """Return periodic problems with their loadings, by load."""
    grid = _unit(n)
    x, y = np.meshgrid(grid.x() - SIDE / 2, grid.y() - SIDE / 2)
    sphere = (x**2 + y**2) * SLOPE / np.sqrt(4 * np.mean(x**2 + y**2))
    shapes = [sphere]
    for seed, (hurst, rolloff, cells) in enumerate(((0.8, 1 / 8, 8), (0.8, 1 / 8, 2), (0.5, 1 / 2, 4)), 1):
        shapes.append(-Spectrum(hurst, rolloff * SIDE, cells=cells).height(grid, seed))
    loads = [load * FORCE for load in (0.003, 0.01, 0.05, 0.3, 1.0)]
    return {"load": [(ContactProblem(grid, MATERIAL, shape, periodic=True), loads) for shape in shapes]}


def counted(problems, options, progress):
    """Return mean applications as text, with the number of failures."""
    means, unsolved, fallbacks = [], 0, 0
    for kind, pairs in problems.items():
        applications = []
        for problem, values in pairs:
            with ContactSolver(problem, options=options) as solver:
                for value in values:
                    solution = solver.solve(**{kind: value})
                    applications.append(solution.operator_applications)
                    unsolved += not solution.converged
                    fallbacks += solution.fallbacks
                    progress.update()
        means.append(f"{np.exp(np.mean(np.log(applications))):.1f}")
    trouble = [f"{fallbacks} safeguarded"] * bool(fallbacks) + [f"{unsolved} unsolved"] * bool(unsolved)
    return ", ".join(means) + (f" ({', '.join(trouble)})" if trouble else "")


def main():
    """Count applications and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--periodic", action="store_true", help="the default method of periodic patches")
    parser.add_argument("--size", type=int, help="cells in each direction; default: 512")
    words = parser.parse_args()
    if words.periodic:
        problems, method = periodic_problems(words.size or 512), "primal"
        constants, techniques = PERIODIC, {}
    else:
        problems, method = free_problems(words.size or 512), "fast"
        constants, techniques = FREE, TECHNIQUES
    each = sum(len(values) for pairs in problems.values() for _, values in pairs)
    with tqdm(
        total=each * (1 + len(techniques) + 2 * len(constants)), unit=" solves", disable=None
    ) as progress:

        def count(options):
            return counted(problems, options, progress)

        rows = [{"switched off": "nothing", "applications": (usual := count({}))}]
        for name, options in techniques.items():
            how = " ".join(f"-{option} {value}" for option, value in options.items())
            rows.append({"switched off": f"{name}: `{how}`", "applications": count(options)})
            progress.write(str(rows[-1]))
        changed = []
        for constant in constants:
            value = constant.value(method)
            whole = isinstance(value, int) or (value.is_integer() and value > 1)
            half, double = (max(1, round(value * by)) if whole else value * by for by in (0.5, 2))
            changed.append(
                {
                    "constant": str(constant),
                    "value": f"{value:g}",
                    "what it is": constant.meaning,
                    "halved": constant.count(count, half),
                    "doubled": constant.count(count, double),
                }
            )
            progress.write(str(changed[-1]))
    print(f"Applications {', '.join(f'by {kind}' for kind in problems)}; as it is: {usual}\n")
    print(format_markdown(rows) if techniques else "", format_markdown(changed), sep="\n")


if __name__ == "__main__":
    main()
