"""Statistics of heights: moments, slopes, power spectrum, normal plot.

The mean of the heights is subtracted first. The Fourier transform of heights z on n_y x n_x cells is
``Z(q) = dx dy sum_j z_j exp(-i q . x_j)``, the power spectral density ``C(q) = |Z(q)|^2 / (l_x l_y)`` with l_x, l_y the
sides of the patch, so that ``<z^2> = 1/(l_x l_y) sum_q C(q) = 1/(2 pi)^2 integral of C``.
"""

from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.special import ndtri

from app.base.errors import InputError
from app.base.types import ArrayLike, Floats
from app.problems.arrays import real_numbers
from app.problems.surfaces.measured_surface import Surface
from app.reference.base import require_positive


@dataclass(frozen=True)
class Roughness:
    """Moments of height and slope.

    Attributes
    ----------
    rms_height : float
        Standard deviation of the height [mm], Sq of ISO 25178.
    rms_slope_x, rms_slope_y, rms_slope : float
        Root mean square of dz/dx, dz/dy and of the gradient's length.
    skewness, kurtosis : float
        Third and fourth standardised moments of the heights (0 and 3 for Gaussian heights); NaN for a flat surface.
    arithmetic_mean_height, maximum_height : float
        Sa, the heights' mean distance from their mean, and Sz, the distance from the lowest to the highest height [mm].
    """

    rms_height: float
    rms_slope_x: float
    rms_slope_y: float
    rms_slope: float
    skewness: float
    kurtosis: float
    arithmetic_mean_height: float
    maximum_height: float


@dataclass(frozen=True)
class RadialSpectrum:
    """Power spectral density averaged over rings of wave vectors.

    Attributes
    ----------
    wave_number : ndarray, shape (rings,), [1/mm]
        Mean of ``|q| = 2 pi / wavelength`` in the ring.
    density : ndarray, shape (rings,), [mm^4]
        Mean of the power spectral density C(q) in the ring.
    count : ndarray of int, shape (rings,)
        Number of wave vectors in the ring.
    """

    wave_number: Floats
    density: Floats
    count: np.ndarray


@dataclass(frozen=True)
class NormalPlot:
    """Normal probability plot: a straight line for Gaussian heights.

    Attributes
    ----------
    quantile : ndarray, shape (n,)
        Standard normal quantiles of the probabilities (i - 1/2) / n.
    height : ndarray, shape (n,), [mm]
        Heights in increasing order.
    correlation : float
        Correlation coefficient of quantiles and heights; NaN for a flat surface.
    """

    quantile: Floats
    height: Floats
    correlation: float


def _check_finite(height):
    height = real_numbers("heights", height, "an array of real numbers")
    if not np.isfinite(height).all():
        raise InputError("heights must be finite; cut out NaN, or read_surface(..., missing='fill')")
    return height


def _check_cells(height, least, **sizes):
    require_positive(**sizes)
    height = _check_finite(height)
    if height.ndim != 2 or min(height.shape) < least:
        raise InputError(f"heights of shape {height.shape}: need (ny, nx), at least {least} x {least}")
    return height


def roughness(height: ArrayLike | Surface, dx: float | None = None, dy: float | None = None) -> Roughness:
    """Return the `Roughness` of heights in cells of dx x dy [mm].

    The heights have the shape (ny, nx), at least 2 x 2. Instead of heights, dx and dy, a `Surface` with known cells may
    be given. A slope is the difference between neighbouring cells divided by their distance. So the slope of a wave
    cos(q x) is too small by the factor sin(q dx / 2) / (q dx / 2).
    """
    if hasattr(height, "heights"):
        height, (dx, dy) = height.heights(), height.spacing or (None, None)
    height = _check_cells(height, 2, dx=dx, dy=dy)
    deviation = height - height.mean()
    rms_height = np.sqrt(np.mean(deviation**2))
    slope_x = np.sqrt(np.mean((np.diff(height, axis=1) / dx) ** 2))
    slope_y = np.sqrt(np.mean((np.diff(height, axis=0) / dy) ** 2))
    maximum = np.ptp(height)
    flat = maximum == 0  # rms_height may differ from 0 by rounding
    skewness, kurtosis = (np.nan if flat else np.mean((deviation / rms_height) ** k) for k in (3, 4))
    moments = rms_height, slope_x, slope_y, np.hypot(slope_x, slope_y), skewness, kurtosis
    return Roughness(*map(float, (*moments, np.abs(deviation).mean(), maximum)))


def radial_spectrum(height: ArrayLike, dx: float, dy: float, window: bool = False) -> RadialSpectrum:
    """Return the `RadialSpectrum` of heights in cells of dx x dy [mm].

    The heights have the shape (ny, nx), at least 4 x 4. A ring is as wide as the larger spacing of the wave vectors in
    x or y. The rings end below the smaller Nyquist wave number, because larger rings would not be closed. If `window`
    is true, the heights are multiplied by a Hann window of mean square 1. Use the window for patches that are not
    periodic, because the step from one side to the other would add to the spectrum.
    """
    height = _check_cells(height, 4, dx=dx, dy=dy)
    height = height - height.mean()
    ny, nx = height.shape
    if window:
        weight = np.outer(*(np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2 for n in (ny, nx)))
        height *= weight / np.sqrt(np.mean(weight**2))
    density = np.abs(dx * dy * scipy.fft.fft2(height)) ** 2 / (nx * dx * ny * dy)
    qx, qy = 2 * np.pi * scipy.fft.fftfreq(nx, dx), 2 * np.pi * scipy.fft.fftfreq(ny, dy)
    q = np.hypot(qx, qy[:, None])
    width = 2 * np.pi / min(nx * dx, ny * dy)
    rings = int(np.pi / max(dx, dy) / width * (1 + 1e-12) - 0.5)
    ring = np.rint(q / width).astype(int).ravel()
    count, q_sum, density_sum = (
        np.bincount(ring, weights, rings + 1)[1 : rings + 1] for weights in (None, q.ravel(), density.ravel())
    )
    return RadialSpectrum(q_sum / count, density_sum / count, count)


def normal_plot(height: ArrayLike) -> NormalPlot:
    """Return the `NormalPlot` of at least 2 heights [mm].

    Fig. 12(d) of the paper is such a plot.
    """
    height = np.sort(_check_finite(height), axis=None)
    if height.size < 2:
        raise InputError("a normal plot needs at least 2 heights")
    quantile = ndtri((np.arange(height.size) + 0.5) / height.size)
    flat = height[0] == height[-1]
    correlation = np.nan if flat else float(np.corrcoef(quantile, height)[0, 1])
    return NormalPlot(quantile, height, correlation)
