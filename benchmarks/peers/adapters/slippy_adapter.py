"""slippy: bound-constrained CG by approach, Polonsky and Keer's CG by load; FFTW.

The functions are those its `StaticStep` calls, in the same way. Square cells only: its influence coefficients are
wrong on others, although they take two spacings.
"""

import numpy as np
import slippy

slippy.CORES = 1
from protocol import Counted, Outcome, Variant, serve  # noqa: E402
from slippy.core import bccg, elastic_influence_matrix_spatial, plan_convolve, polonsky_and_keer  # noqa: E402

VARIANTS = {"bccg": Variant("approach"), "polonsky_and_keer": Variant("load")}


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    span, spacing = (2 * problem.ny, 2 * problem.nx), (problem.dy, problem.dx)
    # One elastic body on a rigid one, so that its modulus is half the combined one.
    modulus = problem.shear_modulus / 2
    kernel = elastic_influence_matrix_spatial("zz", span, spacing, modulus, problem.poisson_ratio)
    domain = problem.interpenetrating if variant == "bccg" else None
    convolve = plan_convolve(problem.open_gap, kernel, domain, circular=False, fft_im=False)

    def by_approach(tolerance):
        product = Counted(convolve)
        overlap = (problem.approach - problem.open_gap)[domain]
        values, failed = bccg(product, overlap, tolerance, 20000, np.zeros_like(overlap))
        pressure = np.zeros_like(problem.open_gap)
        pressure[domain] = values
        return Outcome(pressure, product.calls - 1, product.calls, not failed)

    def by_load(tolerance):
        product = Counted(convolve)
        start = np.ones_like(problem.open_gap)
        failed, pressure, _ = polonsky_and_keer(
            product, start, problem.open_gap, problem.load, list(spacing), tolerance, 20000
        )
        return Outcome(pressure, product.calls // 2, product.calls, not failed)

    return by_approach if variant == "bccg" else by_load


if __name__ == "__main__":
    serve(["slippy", "numpy", "pyFFTW", "numba"], VARIANTS, prepare, square=True)
