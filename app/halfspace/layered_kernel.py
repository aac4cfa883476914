"""Kernel of bodies with layers.

One body has a layer on its surface, or both have. A body without a layer is a half-space or rigid.
"""

from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from app.halfspace.grid import row_blocks
from app.halfspace.kernel import Kernel
from app.halfspace.layer_coefficients import MAX_REACH, layer_tables, layered_coefficients
from app.halfspace.love import love_coefficients
from app.halfspace.periodic_symbol import influence_symbol

_NEAR_CELLS, _BULGE = 3, 3.0  # cells, and thicknesses, within which a coefficient is negative if any is
_MAX_ALIASES = 6  # in each direction, for eigenvalues that need not be exact
_LONG_WAVE = 0.01  # q t of the wave from which a and k of a film are computed
_MAX_FILM_CELL = 3.0  # largest cell over the thickness on which a thin film is solved
_FILM_RATIO = 0.03  # eigenvalue of the longest wave over the largest one, below which a layer is a thin film
_MAX_DECAY = 19.0  # q t above which S(q t) - 1, at most about (q t)^2 exp(-2 q t), is below rounding


class LayeredKernel(Kernel):
    """Kernel of a layer on one or both bodies.

    The base of a layer is a half-space or rigid. For a pressure wave of wave number q, the compliance of a layered body
    is ``c1 S(q t)``. c1 is the compliance of the layer's material, t the thickness, and S the ratio of
    `app.halfspace.layer`. The compliances of the two bodies are added.

    Parameters
    ----------
    layers : tuple of Layer
        One layer, or one on each body.
    other : float
        (1 - nu) / (2 pi G) of a body without a layer [mm2/N]; 0: rigid.

    Attributes
    ----------
    compliance : float
        Compliance for waves much shorter than the layer is thick [mm2/N].
    """

    has_image_sums = has_love_symbol = True

    def __init__(self, layers, other=0.0):
        super().__init__(sum(layer.plane_compliance for layer in layers) + other)
        self.layers, self.other = layers, float(other)
        self.far_reaching = not any(layer.on_rigid_base for layer in layers)

    @property
    def parameters(self):
        """Numbers that define the kernel."""
        numbers = ((layer.thickness, *layer.young, *layer.poisson) for layer in self.layers)
        return *(number for each in numbers for number in each), self.other

    def in_units(self, length):
        """Return the kernel in other units; see `Kernel.in_units`."""

        def scaled(layer):
            young = tuple(self.compliance * young for young in layer.young)
            return replace(layer, thickness=layer.thickness / length, young=young)

        return LayeredKernel(tuple(map(scaled, self.layers)), self.other / self.compliance)

    def uniform_compliance(self, grid):
        """Return the displacement by pressure 1 on all cells; see `Kernel`."""
        return sum(layer.uniform_compliance for layer in self.layers) if grid.doubly_periodic else 0.0

    def wave_compliance(self, qx, qy=0.0):
        """Return the compliance for waves; see `Kernel.wave_compliance`."""
        q = np.hypot(qx, qy)
        return sum(layer.plane_compliance * layer.ratio(q) for layer in self.layers) + self.other

    def line_reach(self):
        """Return the least distance [mm] at which a line of force may be without effect.

        Else a load on a stiff layer, which spreads it, would displace the bodies less than the same load there.
        """
        return max(layer.thickness * max(2.0, np.sqrt(layer.long_wave_ratio)) for layer in self.layers)

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix; see `influence_symbol`."""
        if grid.periodic != "love":
            return super().eigenvalues(grid, columns, rows)
        half_space = influence_symbol(grid, self.compliance, columns, rows)
        return half_space + self._alias_sums(grid, np.asarray(columns), np.asarray(rows))

    def _alias_sums(self, grid, columns, rows, highest=np.inf):
        """Return the part of all layers in the eigenvalues of a layered body."""
        return 2 * np.pi * sum(_alias_sums(layer, grid, columns, rows, highest) for layer in self.layers)

    def unit_coefficients(self, grid, rows, columns):
        """Return coefficients for unit compliance; see `Kernel.unit_coefficients`."""
        love = love_coefficients((grid.dx, grid.dy), 1.0, rows, columns)
        total = self.other * love
        for layer in self.layers:
            own = layered_coefficients(layer, (grid.dx, grid.dy), rows, columns, love)
            total += layer.plane_compliance * own
        return total / self.compliance

    def layer_influence(self, distances):
        """Return the displacement by a point force, for unit compliance [1/mm].

        The displacement of half-spaces of the layers' materials is left out.
        """
        total = 0.0
        for layer in self.layers:
            r = distances / layer.thickness
            own = layer_tables(layer).influence(r)
            if layer.on_rigid_base:
                own = np.where(r > MAX_REACH, -1 / np.maximum(r, MAX_REACH), own)
            total = total + layer.plane_compliance / layer.thickness * own
        return total / self.compliance

    def least_influence(self, near, far):
        """Return lower bounds of the displacement by a point force; see `Kernel.least_influence`."""
        total = self.other / far
        for layer in self.layers:
            own = layer_tables(layer).least_influence(near / layer.thickness, far / layer.thickness)
            if layer.on_rigid_base:
                reach = MAX_REACH * layer.thickness
                own = np.where(near > reach, 0.0, np.where(far > reach, np.minimum(own, 0.0), own))
            total = total + layer.plane_compliance / layer.thickness * own
        return total

    def scale_sampled(self, eigenvalues, grid, columns, rows):
        """Return the eigenvalues of a layered body; see `Kernel.scale_sampled`."""
        highest = 2 * np.pi * _MAX_ALIASES / max(grid.dx, grid.dy)
        return self.compliance * eigenvalues + self._alias_sums(grid, columns, rows, highest)

    def is_positive(self, grid):
        """Return whether no influence coefficient is negative."""
        return _least_coefficient(self, grid) >= 0

    def softest_parts(self, length):
        """Return a displacement and a compliance; see `Kernel.softest_parts`."""
        q = np.array([np.pi / length])
        rigid, compliance = 0.0, self.other
        for layer in self.layers:
            if layer.on_rigid_base:
                longest = 2 * np.pi * layer.plane_compliance * float(layer.ratio(q)[0]) / q[0]
                rigid += max(longest, layer.uniform_compliance)
            else:
                softest = max(1.0, layer.long_wave_ratio)
                compliance += layer.plane_compliance * softest
        return rigid, compliance

    @cached_property
    def film(self):
        """Numbers a [mm3/N] and k [mm5/N] of the eigenvalues a + k q^2 for long waves.

        None unless all layers are on rigid bases, and k is positive.
        """
        if self.other or not all(layer.on_rigid_base for layer in self.layers):
            return None
        uniform = sum(layer.uniform_compliance for layer in self.layers)
        q = np.array([0.5, 1.0]) * (_LONG_WAVE / max(layer.thickness for layer in self.layers))
        half, whole = (2 * np.pi * self.wave_compliance(q) / q - uniform) / q**2
        squeeze = float(4 * half - whole) / 3  # limit for q = 0
        return (uniform, squeeze) if squeeze > 0 else None

    def is_thin_film(self, grid):
        """Return whether long waves displace the bodies much less than shorter ones; see `Kernel`."""
        if self.film is None:
            return False
        spectrum = self._spectrum(grid)
        return bool(spectrum[0] < _FILM_RATIO * spectrum.max())

    def is_resolved(self, grid):
        """Return whether cells are small enough; see `Kernel`.

        A uniform pressure on a wide cell hardly displaces the centre of the cell if the layer is incompressible.
        """
        widest = _MAX_FILM_CELL * max(layer.thickness for layer in self.layers)
        return grid.symbol == "spectral" or grid.widest_cell <= widest or not self.is_thin_film(grid)


def _alias_sums(layer, grid, columns, rows, highest):
    """Return the part of eigenvalues due to the layer, divided by 2 pi.

    This part is the eigenvalue of the layered body minus the eigenvalue of a half-space of the layer's material, for
    uniform pressures on cells. Waves with large q t, or beyond the wave number `highest`, do not count.
    """
    highest = min(highest, _MAX_DECAY / layer.thickness)
    (x, in_x), (y, in_y) = (
        _aliases(index, n, d, highest) for index, n, d in ((columns, grid.nx, grid.dx), (rows, grid.ny, grid.dy))
    )  # fmt: skip
    total, qy, weights = np.zeros((columns.size, rows.size)), y.reshape(-1), in_y.reshape(-1)
    for selected in row_blocks(columns.size, x.shape[0] * qy.size):
        qx = x[:, selected].reshape(-1, 1)
        q = np.hypot(qx, qy)
        waves = (q > 0) & (q < highest)
        terms = np.zeros(q.shape)
        terms[waves] = (layer.ratio(q[waves]) - 1) / q[waves]
        terms *= in_x[:, selected].reshape(-1, 1) * weights
        total[selected] = terms.reshape(x.shape[0], -1, *y.shape).sum(axis=(0, 2))
    total[np.ix_(columns == 0, rows == 0)] = 0.0
    return layer.plane_compliance * total


def _aliases(index, n, d, highest):
    """Return aliased wave numbers up to `highest`, and sinc, shape (aliases, index)."""
    count = int(highest * d / (2 * np.pi)) + 1
    waves = index / n + np.arange(-count, count + 1)[:, None]
    return 2 * np.pi * waves / d, np.sinc(waves)


@lru_cache(maxsize=16)
def _least_coefficient(kernel, grid):
    """Return the smallest influence coefficient near a cell.

    Negative coefficients, if any, begin within a few thicknesses.
    """
    thickness = max(layer.thickness for layer in kernel.layers)
    near = (int(_NEAR_CELLS + _BULGE * thickness / d) for d in (grid.dy, grid.dx))
    rows, columns = (min(n, count) for n, count in zip(grid.shape, near, strict=True))
    return float(kernel.coefficients(grid, np.arange(rows), columns).min())
