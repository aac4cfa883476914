"""Kernel of a body with a layer, and of another body.

The layer is on the surface of the first body. The other body is a half-space or rigid.
"""

from functools import lru_cache

import numpy as np

from app.halfspace.grid import row_blocks
from app.halfspace.kernel import HalfSpaceKernel
from app.halfspace.layer_coefficients import layer_tables
from app.halfspace.love import love_coefficients
from app.halfspace.periodic_symbol import wave_numbers

_SAMPLES = 200  # wave numbers at which the smallest and the largest eigenvalue are sought
_LOVE_FACTORS = 0.5, 2.0  # bounds of an eigenvalue for uniform cells over that of the same wave
_NEAR_CELLS, _BULGE = 3, 3.0  # cells, and thicknesses, within which a coefficient is negative if any is
_MAX_REACH = 30.0  # distance in thicknesses beyond which a layer on a rigid base is not displaced
_MAX_DECAY = 19.0  # q t above which S(q t) - 1, at most about (q t)^2 exp(-2 q t), is below rounding


class LayeredKernel(HalfSpaceKernel):
    """Kernel of a layer on a base, and of a half-space on top.

    The base is a half-space or rigid. For a pressure wave of wave number q, the compliance is ``c1 S(q t) + c``. c1 is
    the compliance of the layer's material, c that of the other body, t the thickness, and S the ratio of
    `app.halfspace.layer`.

    Parameters
    ----------
    layer : Layer
    other : float
        (1 - nu) / (2 pi G) of the other body [mm2/N]; 0: rigid.

    Attributes
    ----------
    compliance : float
        Compliance for waves much shorter than the layer is thick [mm2/N].
    """

    scale_free = False

    def __init__(self, layer, other=0.0):
        super().__init__(layer.plane_compliance + other)
        self.layer, self.other = layer, float(other)
        self.far_reaching = not layer.on_rigid_base

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        layer = self.layer
        return layer.thickness, *layer.young, *layer.poisson, self.other

    def uniform_compliance(self, grid):
        """Return the displacement by pressure 1 on all cells.

        See `HalfSpaceKernel.uniform_compliance`.
        """
        return self.layer.uniform_compliance if grid.periodic else 0.0

    def wave_compliance(self, q):
        """Return the compliance for pressure waves [mm2/N].

        `q` is an array of wave numbers above 0 [1/mm].
        """
        return self.layer.plane_compliance * self.layer.ratio(q) + self.other

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix; see `influence_symbol`."""
        if grid.periodic == "love":
            half_space = super().eigenvalues(grid, columns, rows)
            return half_space + 2 * np.pi * self._alias_sums(grid, np.asarray(columns), np.asarray(rows))
        qx, qy = wave_numbers(grid, columns, rows)
        q = np.hypot(qx[:, None], qy)
        waves = q > 0
        values = np.zeros(q.shape)
        values[waves] = 2 * np.pi * self.wave_compliance(q[waves]) / q[waves]
        return values

    def _alias_sums(self, grid, columns, rows):
        """Return sums of ``c1 (S - 1) sinc sinc / |q|`` over aliased waves q.

        The sum is an eigenvalue of the layer minus that of a half-space of the layer's material, over 2 pi, for uniform
        pressures on cells. Waves with large q t do not count.
        """
        highest = _MAX_DECAY / self.layer.thickness
        (x, in_x), (y, in_y) = (
            _aliases(index, n, d, highest) for index, n, d in ((columns, grid.nx, grid.dx), (rows, grid.ny, grid.dy))
        )  # fmt: skip
        total, qy, weights = np.zeros((columns.size, rows.size)), y.reshape(-1), in_y.reshape(-1)
        for selected in row_blocks(columns.size, x.shape[0] * qy.size):
            qx = x[:, selected].reshape(-1, 1)
            q = np.hypot(qx, qy)
            waves = (q > 0) & (q < highest)
            terms = np.zeros(q.shape)
            terms[waves] = (self.layer.ratio(q[waves]) - 1) / q[waves]
            terms *= in_x[:, selected].reshape(-1, 1) * weights
            total[selected] = terms.reshape(x.shape[0], -1, *y.shape).sum(axis=(0, 2))
        total[np.ix_(columns == 0, rows == 0)] = 0.0
        return self.layer.plane_compliance * total

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch; see `love_coefficients`."""
        return self._coefficients(grid, rows, np.arange(columns))

    def unit_coefficients(self, grid, rows, columns):
        """Return influence coefficients divided by the compliance.

        See `HalfSpaceKernel.unit_coefficients`.
        """
        return self._coefficients(grid, rows, columns) / self.compliance

    def _coefficients(self, grid, rows, columns):
        """Return influence coefficients at offsets in y and x.

        The arrays `rows` and `columns` are the offsets.
        """
        layer = self.layer
        love = love_coefficients((grid.dx, grid.dy), 1.0, rows, int(columns.max(initial=-1)) + 1)[:, columns]
        cell = grid.dx / layer.thickness, grid.dy / layer.thickness
        own = love + layer.thickness * layer_tables(layer, cell).integrals(cell, rows, columns)
        if layer.on_rigid_base:
            distances = np.hypot(cell[0] * columns, cell[1] * rows[:, None])
            own[distances > _MAX_REACH] = 0.0  # below rounding
        return layer.plane_compliance * own + self.other * love

    def scale(self, eigenvalues, q):
        """Return eigenvalues times the compliance of waves; see `HalfSpaceKernel`."""
        with np.errstate(invalid="ignore"):  # on a rigid base the compliance for constants is 0
            return self.wave_compliance(np.maximum(q, np.finfo(float).tiny)) * eigenvalues

    def is_positive(self, grid):
        """Return whether no influence coefficient is negative."""
        return _least_coefficient(self, grid) >= 0

    def middle_displacement(self, lengths):
        """Return a bound of the displacement of a rectangle [mm].

        The rectangle is loaded, and the displacement is that of its middle.
        """
        layer = self.layer
        if layer.on_rigid_base:
            q = np.pi / max(lengths)
            longest = 2 * np.pi * layer.plane_compliance * float(layer.ratio(np.array([q]))[0]) / q
            return max(longest, layer.uniform_compliance) + HalfSpaceKernel(self.other).middle_displacement(
                lengths
            )
        softest = max(1.0, layer.modulus_ratio * (1 - layer.poisson[1]) / (1 - layer.poisson[0]))
        return HalfSpaceKernel(layer.plane_compliance * softest + self.other).middle_displacement(lengths)

    def self_displacement(self, grid):
        """Estimate the displacement of a cell by pressure 1 on it."""
        cell = HalfSpaceKernel(self.compliance_at(max(grid.dx, grid.dy)) / np.pi)
        return cell.self_displacement(grid)

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of the eigenvalues of A [mm / (N/mm2)].

        The eigenvalues are those on fields without mean.
        """
        return (1.0 if grid.periodic == "spectral" else _LOVE_FACTORS[0]) * float(self._spectrum(grid).min())

    def largest_eigenvalue(self, grid):
        """Return an upper bound of the eigenvalues of A [mm / (N/mm2)]."""
        return (_LOVE_FACTORS[1] if grid.periodic == "love" else 1.0) * float(self._spectrum(grid).max())

    def _spectrum(self, grid):
        """Sample the eigenvalues from the longest wave, of which half fits into a free patch."""
        longest = max(grid.nx * grid.dx, grid.ny * grid.dy) * (1 if grid.periodic else 2)
        q = np.geomspace(2 * np.pi / longest, np.pi * np.hypot(1 / grid.dx, 1 / grid.dy), _SAMPLES)
        return 2 * np.pi * self.wave_compliance(q) / q

    def punch_stiffness(self, area):
        """Return the stiffness of a round flat punch [N/mm].

        `area` is the area of the punch [mm2]. The stiffness is exact for radii much smaller than the thickness and, on
        a compressible layer, much larger.
        """
        radius = np.sqrt(area / np.pi)
        compliance = float(self.wave_compliance(np.array([4 / (np.pi * radius)]))[0])
        return 2 / (np.pi * compliance) * radius

    def compliance_at(self, length):
        """Return 1 / E* for waves of a length [mm2/N].

        `length` is in mm.
        """
        return np.pi * float(self.wave_compliance(np.array([2 * np.pi / length]))[0])


def _aliases(index, n, d, highest):
    """Return wave numbers and sinc of aliased waves along an axis.

    The shape is (aliases, index). There are `n` cells of length `d`. Waves beyond the wave number `highest` are left
    out.
    """
    count = int(highest * d / (2 * np.pi)) + 1
    waves = index / n + np.arange(-count, count + 1)[:, None]
    return 2 * np.pi * waves / d, np.sinc(waves)


@lru_cache(maxsize=16)
def _least_coefficient(kernel, grid):
    """Return the smallest influence coefficient near a cell.

    Negative coefficients, if any, begin within a few thicknesses.
    """
    near = (int(_NEAR_CELLS + _BULGE * kernel.layer.thickness / d) for d in (grid.dy, grid.dx))
    rows, columns = (min(n, count) for n, count in zip(grid.shape, near, strict=True))
    return float(kernel.coefficients(grid, np.arange(rows), columns).min())
