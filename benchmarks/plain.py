"""Plain FFT products by scipy: the unit of all timings, and an independent check."""

import time

import numpy as np
import scipy.fft

from app.halfspace.influence import influence_quadrant
from app.halfspace.kernel import UNIT


class PlainProduct:
    """Plain product u = A p: padded rfft2, multiply, irfft2.

    One thread, double precision.
    """

    def __init__(self, grid, kernel=UNIT):
        ny, nx = self.shape = grid.shape
        self.padded = 2 * ny, 2 * nx
        quadrant = influence_quadrant(grid, kernel)
        kernel = np.zeros(self.padded)
        kernel[:ny, :nx] = quadrant
        kernel[:ny, nx + 1 :] = quadrant[:, :0:-1]
        kernel[ny + 1 :, :nx] = quadrant[:0:-1]
        kernel[ny + 1 :, nx + 1 :] = quadrant[:0:-1, :0:-1]
        self.spectrum = scipy.fft.rfft2(kernel)

    def __call__(self, p):
        """Return A p."""
        ny, nx = self.shape
        product = scipy.fft.rfft2(p, s=self.padded) * self.spectrum
        return scipy.fft.irfft2(product, s=self.padded)[:ny, :nx]


class PlainPeriodicProduct:
    """Plain product on a periodic patch: rfft2, multiply by 2 / (E* |q|), irfft2.

    One thread, no padding. With a `thickness`, the body is a layer on a rigid base; the symbol is then multiplied by
    the ratio of Johnson, Contact Mechanics, Sec. 5.8, for Poisson's ratio `poisson`.
    """

    def __init__(self, grid, contact_modulus, thickness=np.inf, poisson=0.0):
        ny, nx = self.shape = grid.shape
        q = 2 * np.pi * np.hypot(np.fft.fftfreq(ny, grid.dy)[:, None], np.fft.rfftfreq(nx, grid.dx))
        q[0, 0] = np.inf
        self.symbol = 2 / (contact_modulus * q)
        if np.isfinite(thickness):
            x, a = np.minimum(q * thickness, 300.0), 3 - 4 * poisson
            top = a * np.sinh(2 * x) - 2 * x
            self.symbol *= top / (a * np.cosh(2 * x) + 2 * x**2 + (1 + a**2) / 2)

    def __call__(self, p):
        """Return A p, of mean 0."""
        return scipy.fft.irfft2(scipy.fft.rfft2(p) * self.symbol, s=self.shape)


def seconds(function, repeats=5, clock=time.perf_counter):
    """Shortest of a few runs of ``function()``."""
    shortest = np.inf
    for _ in range(repeats):
        started = clock()
        function()
        shortest = min(shortest, clock() - started)
    return shortest


def check(product, p, h):
    """Return residual of (5.1), penetration over max |h|, and smallest over largest pressure.

    `h` is NaN in inadmissible cells.
    """
    e = h + product(p)
    admissible, contact = ~np.isnan(h), p > 0
    norm, deepest, highest = np.linalg.norm(h[admissible]), np.abs(h[admissible]).max(), p.max()
    return {
        "residual": float(np.linalg.norm(e[contact]) / norm),
        "penetration": float(max(-e[admissible].min(), 0.0) / deepest),
        "tension": float(max(-p.min(), 0.0) / highest) if highest > 0 else 0.0,
        "outside": bool((p[~admissible] == 0).all()),
    }


def check_periodic(product, p, distance, mean_pressure, hardness=np.inf):
    """Return the same on a periodic patch, over the standard deviation of h.

    A mean pressure says nothing of the approach: it is the one that fits the cells under pressure best. `residual`: rms
    of the gap there; `penetration`: the largest; `tension`: smallest over largest pressure; `load_error`: of the mean
    pressure. With a hardness, cells with p = hardness (to 1e-9) are plastic. Their gap e must not be positive:
    `penetration` includes the largest one. `tension` includes the excess of p over the hardness. Without elastic cells
    the approach is the least one at which no plastic cell has a gap.
    """
    plastic = p >= hardness * (1 - 1e-9)
    elastic = (p > 0) & ~plastic
    e = distance + product(p)
    e -= e[elastic].mean() if elastic.any() else e[plastic].max()
    size = distance.std()
    return {
        "residual": float(np.sqrt(np.mean(e[elastic] ** 2)) / size) if elastic.any() else 0.0,
        "penetration": float(np.where(plastic, e, -e).max(initial=0.0) / size),
        "tension": float(max(-p.min(), p.max() - hardness, 0.0) / p.max()),
        "load_error": float(abs(p.mean() / mean_pressure - 1)),
    }
