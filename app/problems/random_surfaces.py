"""Random rough surfaces: sums of waves.

All ranks evaluate the same function. On coarse grids a `WavySurface` is evaluated in the cell centres of the coarse
grid (Sec. 5.2). A `SelfAffineSurface` is averaged instead, because its short waves would be aliased.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np
import scipy.fft

from app.base.errors import InputError, format_exact
from app.base.memory import check_fits
from app.base.types import ArrayLike, Floats, Length
from app.base.units import to_length
from app.halfspace.grid import Grid
from app.problems.arrays import lattice
from app.reference.base import require_numbers

BLOCK = 32768  # values that stay in cache while the terms of a sum are added
STRIP = 64  # columns or rows of a Fourier sum that are computed together
BYTES_PER_MODE = 88.0  # of work arrays of `WavySurface.height`


def _check_seed(seed):
    if not (isinstance(seed, Integral) and seed >= 0):
        raise InputError(f"surface seed {seed!r}: must be an integer, 0 or more")


def _check_pair(name, pair, needed, above=-np.inf):
    if not (np.shape(pair) == (2,) and np.isfinite(pair).all() and min(pair) > above):
        raise InputError(f"surface {name} {pair}: need two {needed}")


def _product(left, right):
    """Return a matrix product with reproducible rounding.

    With BLAS, the rounding depends on the shapes of the matrices. Here the terms of each entry are rounded and added in
    a fixed order.
    """
    product = np.zeros((left.shape[0], right.shape[1]))
    step = max(1, BLOCK // max(1, right.shape[1]))
    for start in range(0, len(product), step):
        block = product[start : start + step]
        for column, row in zip(left[start : start + step].T, right, strict=True):
            block += column[:, None] * row
    return product


class _Function:
    """Base of surfaces that are functions of position."""

    sampled = False

    def heights_on(self, grid: Grid, rows: slice = slice(None)) -> Floats:
        """Return heights of the cells in `rows` of a grid [mm]."""
        return self.height(grid.x(), grid.y(rows))


@dataclass(frozen=True)
class WavySurface(_Function):
    """The paper's surface: M x N products of cosines.

    The height is the sum (6.1), with random amplitudes a and phases phi, theta, scaled to a standard deviation by
    (6.2). The random numbers come from ``numpy.random.default_rng(seed)`` in the order a, phi, theta, each (M, N).

    Parameters
    ----------
    modes : tuple of int
        M, N: number of waves in x and y, 1 or more.
    decay : float
        gamma, 0 < gamma <= 1: before scaling, the amplitude of wave (m, n) is uniformly distributed on [0,
        gamma^(m+n-2)).
    sigma : float
        Standard deviation of the height over the patch [mm]. The amplitudes are scaled so that it is exact.
    seed : int
    extent : tuple of float
        l_x, l_y: sides of the patch [mm].
    origin : tuple of float
        Lower left corner of the patch [mm]; x and y of (6.1) start there.

    References
    ----------
    J. Zhao, E.A.H. Vollebregt, C.W. Oosterlee, Math. Model. Anal. 19 (2014), appendix; after
    J.J. Kalker, F.M. Dekking, E.A.H. Vollebregt, J. Appl. Mech. 64 (1997).

    Examples
    --------
    >>> surface = WavySurface((12, 10), decay=0.8, sigma=0.1, seed=7, extent=(12.0, 10.0))
    >>> x = (np.arange(64) + 0.5) * 12 / 64
    >>> y = (np.arange(64) + 0.5) * 10 / 64
    >>> round(float(surface.height(x, y).std()), 12)
    0.1
    """

    modes: tuple[int, int]
    decay: float
    sigma: float
    seed: int
    extent: tuple[float, float]
    origin: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self):
        if not (len(self.modes) == 2 and all(isinstance(k, Integral) and k >= 1 for k in self.modes)):
            raise InputError(f"surface modes {tuple(self.modes)}: need two integers M, N, each 1 or more")
        if not 0 < self.decay <= 1:
            raise InputError(f"surface decay {format_exact(self.decay)}: must be above 0 and at most 1")
        if not (np.isfinite(self.sigma) and self.sigma >= 0):
            raise InputError(f"surface sigma {format_exact(self.sigma)}: must be 0 or more, and finite")
        _check_seed(self.seed)
        _check_pair("extent", self.extent, "positive, finite lengths", above=0)
        _check_pair("origin", self.origin, "finite coordinates")
        m, n = self.modes
        check_fits(BYTES_PER_MODE * m * n, f"a surface of {m} x {n} modes")

    @cached_property
    def coefficients(self) -> tuple[Floats, Floats, Floats]:
        """Amplitudes [mm] and both phases of the M x N waves."""
        rng = np.random.default_rng(self.seed)
        m, n = (np.arange(k) for k in self.modes)  # exponents m - 1 and n - 1 of the paper
        a = rng.random(self.modes) * self.decay ** (m[:, None] + n)
        phi = 2 * np.pi * rng.random(self.modes)
        theta = 2 * np.pi * rng.random(self.modes)
        return a * (self.sigma / np.sqrt(np.sum(a**2) / 4)), phi, theta

    @cached_property
    def _wave_numbers(self):
        """Wave numbers of M waves in x and N in y [1/mm]."""
        return [2 * np.pi * np.arange(1, k + 1) / l for k, l in zip(self.modes, self.extent, strict=True)]

    def describe(self) -> dict[str, Any]:
        """Return the parameters by option names, for result files."""
        numbers = {f"surface_{name}": getattr(self, name) for name in ("seed", "sigma", "decay")}
        return {**numbers, "surface_modes": list(self.modes)}

    @property
    def rms_height(self) -> float:
        """Standard deviation of the height over the patch [mm]."""
        # (6.2)
        return float(np.sqrt(np.sum(self.coefficients[0] ** 2) / 4))

    @property
    def rms_slope(self) -> float:
        """Rms length of the gradient over the patch."""
        qx, qy = self._wave_numbers
        a = self.coefficients[0]
        return float(np.sqrt(np.sum(a**2 * (qx[:, None] ** 2 + qy**2)) / 4))

    def height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the height (ny, nx) at x (nx,) and y (ny,) [mm].

        A value depends on its own x and y only, to the last bit. A value costs O(M + N) operations, because cos(a + b)
        = cos a cos b - sin a sin b turns the double sum over the waves into two matrix products.
        """
        a, phi, theta = self.coefficients
        qx, qy = self._wave_numbers
        x, y = lattice(x, y, self.origin)
        along_x, along_y = np.outer(qx, x), np.outer(y, qy)
        in_x, in_y = (np.stack([np.cos(phase), -np.sin(phase)]) for phase in (phi, theta))
        mixing = np.block([[a * x_part * y_part for y_part in in_y] for x_part in in_x]).T
        waves_x = np.vstack([np.cos(along_x), np.sin(along_x)])
        waves_y = np.hstack([np.cos(along_y), np.sin(along_y)])
        # (6.1)
        return _product(waves_y, _product(mixing, waves_x))


def _samples_per_period(coordinates, period):
    """Return the number of equal steps per period.

    None if the coordinates do not have equal steps that divide the period.
    """
    if len(coordinates) < 2 or coordinates[-1] <= coordinates[0]:
        return None
    n = round(period * (len(coordinates) - 1) / (coordinates[-1] - coordinates[0]))
    if n < len(coordinates):
        return None
    lattice = coordinates[0] + np.arange(len(coordinates)) * (period / n)
    tolerance = 8 * np.finfo(float).eps * max(period, np.abs(coordinates).max())
    return n if np.abs(coordinates - lattice).max() <= tolerance else None


def _synthesise(coefficients, first, coordinates, period):
    """Return ``sum_k c[k] exp(2 pi i (first + k) x / period)``.

    Here c are the `coefficients`, with one column for each sum, and x the `coordinates`. The sum is an FFT if the
    coordinates divide the period into equal steps, otherwise a matrix product.
    """
    k = first + np.arange(len(coefficients))
    n = _samples_per_period(coordinates, period)
    if n is None:
        return np.exp(2j * np.pi / period * np.outer(coordinates, k)) @ coefficients
    shifted = coefficients * np.exp(2j * np.pi / period * coordinates[0] * k)[:, None]
    folded = np.zeros((n, shifted.shape[1]), complex)
    for start in range(0, len(k), n):  # aliasing: waves that differ by n are equal in n points
        alias = shifted[start : start + n]
        folded[: len(alias)] += alias
    folded = np.roll(folded, first, axis=0)
    return scipy.fft.ifft(folded, axis=0, norm="forward", overwrite_x=True)[: len(coordinates)]


class SelfAffineSurface(_Function):
    """Isotropic self-affine surface: waves with random phases.

    The height is ``z = sum_k a_k cos(q_k . (x, y) + phi_k)`` with q_k = 2 pi (k_x / l_x, k_y / l_y), one wave of each
    pair +-q_k. The phases are uniformly distributed on [0, 2 pi). The squared amplitudes a_k^2 are proportional to the
    power spectrum (see References), which is

    - proportional to q^(-2-2H) from the roll-off wavelength to the shortest wavelength,
    - constant from the period to the roll-off wavelength, and zero elsewhere.

    As a sum of many independent waves the height is Gaussian. The sum is periodic; use it on a patch inside one period.
    Phases are drawn from small to large wave numbers. So a shorter `shortest_wavelength` adds waves and keeps the
    others, except for the common factor that makes the rms value right.

    Parameters
    ----------
    hurst : float
        Hurst exponent H, 0 < H <= 1.
    rolloff_wavelength, shortest_wavelength : float
        Wavelengths [mm] between which the spectrum has its ranges.
    period : tuple of float
        l_x, l_y: sides of the period [mm].
    seed : int
        Seed of the random phases, 0 or more.
    rms_height, rms_slope : float
        Root mean square over the period of the height [mm] or of the gradient's length; exactly one of them.
    origin : tuple of float
        Lower left corner of the patch [mm].

    Attributes
    ----------
    rms_height, rms_slope : float
        Both root mean squares of this surface over the period [mm], [1].
    wave_numbers : tuple of ndarray
        Integers k_x, shape (K_x + 1,), and k_y, shape (2 K_y + 1,), up to the shortest wavelength.
    coefficients : ndarray, shape (2 K_y + 1, K_x + 1)
        ``a_k exp(i phi_k)`` [mm].

    References
    ----------
    T.D.B. Jacobs, T. Junge, L. Pastewka, Quantitative characterization of surface topography using
    spectral analysis, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001.
    """

    sampled = True  # coarse grids would alias short waves
    refinable = True

    def __init__(
        self,
        hurst: float,
        rolloff_wavelength: Length,
        shortest_wavelength: Length,
        period: Sequence[float],
        seed: int,
        *,
        rms_height: Length | None = None,
        rms_slope: float | None = None,
        origin: Sequence[float] = (0.0, 0.0),
    ) -> None:
        rolloff_wavelength = to_length("rolloff_wavelength", rolloff_wavelength)
        shortest_wavelength = to_length("shortest_wavelength", shortest_wavelength)
        if rms_height is not None:
            rms_height = to_length("rms_height", rms_height)
        require_numbers(**{"Hurst exponent": hurst})
        if not 0 < hurst <= 1:
            raise InputError(f"Hurst exponent {format_exact(hurst)}: must be above 0 and at most 1")
        if not 0 < shortest_wavelength <= rolloff_wavelength < np.inf:
            raise InputError(
                f"surface wavelengths: shortest {format_exact(shortest_wavelength)}, "
                f"roll-off {format_exact(rolloff_wavelength)}: must be positive and in this order"
            )
        _check_pair("period", period, "positive, finite lengths", above=0)
        _check_pair("origin", origin, "finite coordinates")
        _check_seed(seed)
        if (rms_height is None) == (rms_slope is None):
            raise InputError("self-affine surface: give either its rms height or its rms slope")
        target = rms_slope if rms_height is None else rms_height
        require_numbers(**{"surface rms value": target})
        if not (np.isfinite(target) and target >= 0):
            raise InputError(f"surface rms value {format_exact(target)}: must be 0 or more, and finite")
        self.period, self.origin, self.seed = tuple(period), tuple(origin), seed

        # A half-plane of integer wave vectors: k_x = 0 .. K_x and k_y = -K_y .. K_y.
        largest_x, largest_y = (int(l / shortest_wavelength * (1 + 1e-12)) for l in period)
        lengths = " x ".join(map(format_exact, period))
        waves = f"surface wavelengths: {lengths} mm down to {format_exact(shortest_wavelength)} mm"
        check_fits(16.0 * (largest_x + 1) * (largest_y + 1), waves)
        self.wave_numbers = np.arange(largest_x + 1), np.arange(-largest_y, largest_y + 1)
        self.hurst, self.rolloff_wavelength = hurst, rolloff_wavelength
        self.shortest_wavelength = shortest_wavelength
        sums = sum(np.array([power.sum(), np.sum(power * q**2)]) for _, power, q in self._strips())
        if not sums[0]:
            raise InputError(f"{waves}: no wave has this period")
        # Parseval's theorem: a cosine has mean square 1/2.
        height, slope = np.sqrt(sums / 2)
        self._factor = factor = target / (slope if rms_height is None else height)
        self.rms_height, self.rms_slope = float(factor * height), float(factor * slope)

    def __repr__(self):
        return f"<SelfAffineSurface: Hurst exponent {self.hurst:g}, rms slope {self.rms_slope:.4g}, seed {self.seed}>"

    def check_grid(self, grid: Grid) -> None:
        """Raise if a grid has too coarse cells or exceeds the period."""
        check_cut_off(grid, self.shortest_wavelength)
        self._check_span(grid.x(), grid.y())

    def describe(self) -> dict[str, Any]:
        """Return the parameters by option names, for result files."""
        return {
            "surface_hurst": self.hurst,
            "surface_rolloff": self.rolloff_wavelength,
            "surface_cutoff": self.shortest_wavelength,
            "surface_rms_slope": self.rms_slope,
            "surface_rms_height": self.rms_height,
            "surface_seed": self.seed,
        }

    def _check_span(self, *points):
        for name, at, period in zip("xy", points, self.period, strict=True):
            if len(at) and np.ptp(at) >= period * (1 - 1e-12):
                span, most = format_exact(np.ptp(at)), format_exact(period)
                raise InputError(f"surface: points span {span} in {name}, not less than its period {most}")

    def _strips(self):
        """Yield power spectrum and wave numbers q, for slices of k_x.

        Each item also has the slice. The power spectrum is not scaled to the rms value.
        """
        kx, ky = self.wave_numbers
        for start in range(0, len(kx), STRIP):
            columns = slice(start, start + STRIP)
            q = 2 * np.pi * np.hypot(kx[columns] / self.period[0], ky[:, None] / self.period[1])
            power = np.maximum(q * self.rolloff_wavelength / (2 * np.pi), 1) ** (-2 - 2 * self.hurst)
            power[q * self.shortest_wavelength > 2 * np.pi * (1 + 1e-12)] = 0
            if not start:
                power[: ky[-1] + 1, 0] = 0  # q = 0, and -q of the waves kept on the line k_x = 0
            yield columns, power, q

    @property
    def coefficients(self) -> np.ndarray:
        """Complex amplitudes ``a_k exp(i phi_k)`` [mm], rows k_y, columns k_x."""
        power = np.hstack([power for _, power, _ in self._strips()])
        return self._factor * np.sqrt(power) * np.exp(2j * np.pi * self._draws())

    def _draws(self):
        """Return the phases divided by 2 pi; rows are k_y, columns k_x."""
        rng = np.random.default_rng(self.seed)
        largest_x, largest_y = (k[-1] for k in self.wave_numbers)
        # Square rings max(|k_x|, |k_y|) = s of 4 s vectors are drawn in full: phases do not depend on the cut-off.
        draws = np.zeros((2 * largest_y + 1, largest_x + 1))
        for s in range(1, max(largest_x, largest_y) + 1):
            right, top, bottom = np.split(rng.random(4 * s), [2 * s + 1, 3 * s + 1])
            if s <= largest_x:
                rows = min(s, largest_y)
                draws[largest_y - rows : largest_y + rows + 1, s] = right[s - rows : s + rows + 1]
            if s <= largest_y:
                columns = min(s, largest_x + 1)
                draws[largest_y + s, :columns] = top[:columns]
                draws[largest_y - s, 1:columns] = bottom[: columns - 1]
        return draws

    def height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the height (ny, nx) at x (nx,) and y (ny,) [mm].

        x and y must span less than a period. If the steps of x and y divide the period into equal parts, as cell
        centres may do, the sum is computed by an FFT, otherwise by a matrix product. The values agree up to rounding.
        Waves too short for the points are aliased. The work arrays take 16 bytes for each pair of a row and a k_x, and
        8 bytes for each wave.
        """
        x, y = lattice(x, y, self.origin)
        self._check_span(x, y)
        kx, ky = self.wave_numbers
        along_y, draws = np.empty((len(y), len(kx)), complex), self._draws()
        for columns, power, _ in self._strips():
            waves = self._factor * np.sqrt(power) * np.exp(2j * np.pi * draws[:, columns])
            along_y[:, columns] = _synthesise(waves, ky[0], y, self.period[1])
        del draws
        height = np.empty((len(y), len(x)))
        for start in range(0, len(y), STRIP):
            rows = slice(start, start + STRIP)
            height[rows] = _synthesise(along_y[rows].T, kx[0], x, self.period[0]).T.real
        return height


def check_cut_off(grid, shortest):
    """Raise InputError if the shortest wave is shorter than two cells."""
    if shortest < 2 * max(grid.dx, grid.dy) * (1 - 1e-12):
        nx, ny = (int(np.ceil(2 * side / shortest * (1 - 1e-12))) for side in grid.sides)
        raise InputError(
            f"surface cut-off {format_exact(shortest)}: cells of {format_exact(grid.dx)} x {format_exact(grid.dy)} mm "
            f"cannot carry waves that short; must be at least {nx},{ny} cells (-grid), two per wave"
        )
