"""Surface of the Challenge on any grid: from its parameters, or from its file."""

from pathlib import Path

import h5py
import numpy as np
import scipy.fft

from app.halfspace.grid import Grid
from app.problems.random_surfaces import SelfAffineSurface

SIDE = 0.1  # of the patch, also the unit of the Challenge's file [mm]
HURST, ROLLOFF, CUTOFF, SLOPE = 0.8, 0.02, 0.0001, 1.0
RESOLVED = 2048  # cells per side: 2.05 per shortest wave


def look_alike(seed=1):
    """Return heights with the published parameters on the coarsest grid of all waves, (n, n) [mm]."""
    grid = Grid.from_domain(RESOLVED, RESOLVED, (0.0, SIDE, 0.0, SIDE))
    surface = SelfAffineSurface(HURST, ROLLOFF, CUTOFF, (SIDE, SIDE), seed, rms_slope=SLOPE)
    return surface.height(grid.x(), grid.y())


def read_surface(path):
    """Read the heights of the Challenge's file, (n, n) [mm].

    They are in the dataset `surface`, in units of 0.1 mm, with summits up.

    Raises
    ------
    ValueError
        If there is no such file, dataset, or square array of numbers.
    """
    if not Path(path).is_file():
        raise ValueError(f"surface {path}: no such file")
    try:
        with h5py.File(path) as file:
            heights = np.asarray(file["surface"], dtype=float)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"surface {path}: needed: an HDF5 file with a dataset `surface` ({error})") from None
    if heights.ndim != 2 or heights.shape[0] != heights.shape[1] or not np.isfinite(heights).all():
        raise ValueError(f"surface {path}: has shape {heights.shape}; needed: n x n finite numbers")
    return SIDE * heights


def resample(heights, n):
    """Sample the waves on n x n points of the period.

    Waves of two spacings or less of either grid are left out.
    """
    m = len(heights)
    if n == m:
        return heights
    kept = (min(n, m) + 1) // 2
    spectrum = scipy.fft.rfft2(heights, norm="forward")
    there = np.zeros((n, n // 2 + 1), complex)
    there[:kept, :kept] = spectrum[:kept, :kept]
    there[n - kept + 1 :, :kept] = spectrum[m - kept + 1 :, :kept]
    return scipy.fft.irfft2(there, s=(n, n), norm="forward", overwrite_x=True)


def rms_slope(heights):
    """Return the rms slope of the waves on a square period of side `SIDE`."""
    n = len(heights)
    waves = np.abs(scipy.fft.rfft2(heights, norm="forward")) ** 2
    waves[:, 1 : (n + 1) // 2] *= 2  # and their conjugates
    k = np.arange(n // 2 + 1), np.fft.fftfreq(n, 1 / n)[:, None]
    return float(2 * np.pi / SIDE * np.sqrt(np.sum(waves * (k[0] ** 2 + k[1] ** 2))))
