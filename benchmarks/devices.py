"""The tables of docs/notebook/performance.md: the default method without a device, with a constant halved and doubled.

    python -m benchmarks.devices              # free patches, 512 x 512 (three minutes)
    python -m benchmarks.devices --periodic   # periodic ones, 512 x 512 (a minute)

Geometric means of operator applications. Counts do not vary, so others may use the machine meanwhile.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from tqdm import tqdm

from app import ContactProblem, ContactSolver, FlatPunch, Grid, Material, Paraboloid
from app.io.table import markdown
from app.options.method import read_method_file
from app.problems.random_surfaces import WavySurface
from benchmarks.loads import MATERIAL, SIDE, SLOPE, Spectrum

FORCE = MATERIAL.contact_modulus * SLOPE * SIDE**2
# Contact on 1% to 99% of the cells; and on 0.2%, 5%, 35%, 88%.
APPROACHES = (0.00187, 0.0113, 0.0202, 0.037, 0.0899, 0.1768)
LOADS = (0.0005, 0.02, 0.2, 1.0)

DEVICES = {
    "defect correction": {"lcp_defect_correction": 0},
    "lift": {"lcp_prolongation": "copy"},
    "predictor": {"lcp_predictor": 0},
    "means between contacts": {"pc_circulant_blocks": 0},
    "rim extension, and with it these and the predictor": {
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
    """A constant of a module of app/, or an option of the method if there is no module."""

    name: str
    meaning: str
    module: str = ""

    def value(self, method):
        """What it is."""
        if self.module:
            return getattr(import_module(self.module), self.name)
        return float(read_method_file(method)[self.name])

    def count(self, count, value):
        """``count()``, a row of it, with another value."""
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
FREE = (
    Constant("ksp_rtol", "a contact set is solved until its residual is smaller by this"),
    Constant("lcp_coarse_rtol", "residual over h on C that is enough on coarse grids"),
    Constant("lcp_window", "margin of windows, share of the extent of contact"),
    Constant("lcp_predictor", "share of the expected change of u that is believed"),
    Constant("pc_circulant_extend", "cells by which the residual is continued over the rim"),
    Constant("pc_circulant_blocks", "cells of the blocks whose means it begins with"),
    Constant("_LEAST", "share of contact around a cell, beside which less counts little",
        "app.methods.free.block_average"),
    Constant("_SCATTERED", "of the blocks in contact in part: from there on it begins with means",
        "app.methods.free.block_average"),
    Constant("lcp_defect_correction", "share of a residual that is left to the next product"),
    Constant("IN_CONTACT", "(5.1) with h on C alone and so many times rtol", "app.methods.free.stopping"),
    Constant("RELEASED", "share of the load released on a coarse grid without a product", "app.methods.free.iteration"),
    Constant("NEAR", "tolerances by which the approach to a load may be off on a coarse grid",
        "app.methods.free.iteration"),
    Constant("SINGLE", "residual over h on C that is too small for single precision", "app.methods.free.iteration"),
    Constant("FALLEN", "of the largest load since u was computed: below, it is anew", "app.methods.free.iteration"),
    Constant("PATIENCE", "iterations without halving the residual, then the safeguard", "app.methods.progress"),
    Constant("MIN_SECANT_STEP", "rms residuals that the approach has to move by for a secant to count", _LOAD),
    Constant("MAX_SLOPE_RATIO", "factor by which the slope may change at once", _LOAD),
    Constant("MIN_MEAN_SLOPE_FRACTION", "of the mean slope since first touch: a secant counts from there on", _LOAD),
    Constant("LOAD_RESIDUAL_FRACTION", "of the rms residual: the approach may be off by it, unmoved", _LOAD),
    Constant("_TRUSTED", "factor in the load beyond which p is copied, not lifted", "app.methods.free.lift"),
    Constant("_LEAST", "cells around contact in a window, at least", "app.methods.free.windows"),
    Constant("_MOST", "share of the cells; a larger window is none", "app.methods.free.windows"),
    Constant("_NEARLY_NONE", "least pressure of cells with a gap, share of the highest", "app.methods.safeguard"),
)  # fmt: skip
PERIODIC = (
    Constant("_LOOSE", "share of the cells that may still change on a coarse grid", "app.methods.periodic.iteration"),
    Constant("_SLIGHT", "overlap that is left alone, of the error aimed at", "app.methods.periodic.iteration"),
    Constant("_FAR", "overlap that asks for no other contact set, of the error aimed at",
        "app.methods.periodic.iteration"),
    Constant("_SURE", "of the residual allowed is asked of the preconditioned one", "app.methods.periodic.iteration"),
    Constant("_DOUBT", "of what a failed verification asks for is aimed at after it", "app.methods.periodic.iteration"),
    Constant("_UNSURE", "of the error aimed at levels may miss where p is verified", "app.methods.periodic.iteration"),
    Constant("_OFF", "times the error of the residual: from there on p is taken to be off",
        "app.methods.periodic.iteration"),
    Constant("_LOWER", "the same where the load is less than what was left", "app.methods.periodic.iteration"),
    Constant("_GUESSES", "projected sweeps that guess the contact set", "app.methods.periodic.solver"),
    Constant("_SHARE", "of the residual taken along when captured cells are closed", "app.methods.periodic.state"),
    Constant("_CONSTANT", "compliance of a constant, times E*, over the spacing of contact",
        "app.methods.periodic.two_grid"),
    Constant("_BESIDE", "times the contact around: how much less long waves move there",
        "app.methods.periodic.two_grid"),
    Constant("_LONG_WAVES", "grids between one and that of the long waves", "app.methods.periodic.solver"),
    Constant("ksp_rtol", "a contact set is solved until its residual is smaller by this"),
    Constant("lcp_coarse_rtol", "residual that is enough on coarse grids"),
    Constant("lcp_defect_correction", "share of a residual that is left to the next product"),
    Constant("pc_two_grid_sweeps", "sweeps after the coarser grid"),
)  # fmt: skip


def free_problems(n):
    """Problems with the keywords of `ContactSolver.solve`, by approach and by load."""

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
    """As `free_problems`; by load."""
    grid = _unit(n)
    x, y = np.meshgrid(grid.x() - SIDE / 2, grid.y() - SIDE / 2)
    sphere = (x**2 + y**2) * SLOPE / np.sqrt(4 * np.mean(x**2 + y**2))
    shapes = [sphere]
    for seed, (hurst, rolloff, cells) in enumerate(((0.8, 1 / 8, 8), (0.8, 1 / 8, 2), (0.5, 1 / 2, 4)), 1):
        shapes.append(-Spectrum(hurst, rolloff * SIDE, cells=cells).height(grid, seed))
    loads = [load * FORCE for load in (0.003, 0.01, 0.05, 0.3, 1.0)]
    return {"load": [(ContactProblem(grid, MATERIAL, shape, periodic=True), loads) for shape in shapes]}


def counted(problems, options, progress):
    """Geometric means of the applications, as text: by approach, by load; and what went wrong, if something did."""
    means, unsolved, fallbacks = [], 0, 0
    for kind, pairs in problems.items():
        found = []
        for problem, values in pairs:
            with ContactSolver(problem, options=options) as solver:
                for value in values:
                    solution = solver.solve(**{kind: value})
                    found.append(solution.operator_applications)
                    unsolved += not solution.converged
                    fallbacks += solution.fallbacks
                    progress.update()
        means.append(f"{np.exp(np.mean(np.log(found))):.1f}")
    trouble = [f"{fallbacks} safeguarded"] * bool(fallbacks) + [f"{unsolved} unsolved"] * bool(unsolved)
    return ", ".join(means) + (f" ({', '.join(trouble)})" if trouble else "")


def main():
    """Count and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--periodic", action="store_true", help="the default method of periodic patches")
    parser.add_argument("--size", type=int, help="cells in each direction; default: 512")
    words = parser.parse_args()
    if words.periodic:
        problems, method = periodic_problems(words.size or 512), "primal"
        constants, devices = PERIODIC, {}
    else:
        problems, method = free_problems(words.size or 512), "fast"
        constants, devices = FREE, DEVICES
    each = sum(len(values) for pairs in problems.values() for _, values in pairs)
    with tqdm(total=each * (1 + len(devices) + 2 * len(constants)), unit=" solves", disable=None) as progress:

        def count(options):
            return counted(problems, options, progress)

        rows = [{"switched off": "nothing", "applications": (usual := count({}))}]
        for name, options in devices.items():
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
    print(markdown(rows) if devices else "", markdown(changed), sep="\n")


if __name__ == "__main__":
    main()
