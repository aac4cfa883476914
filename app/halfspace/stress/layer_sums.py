"""Sums of stresses in a layered body over waves or cells.

On a periodic patch `app.halfspace.layer_waves` has the waves. On a free patch the stress by a cell is, in the layer,
the stress in a half-space of the layer's material plus a smooth rest; in the base it is the rest alone
(`layer_tables`). On a patch periodic in one direction the same holds for the stress by a strip, and waves add the rest.
A depth equal to the thickness of the layer is in the layer; the next larger number is in the base.
"""

import numpy as np
import scipy.fft

from app.halfspace.layer_waves import LayerWaves
from app.halfspace.periodic_symbol import wave_numbers
from app.halfspace.stress.layer_tables import add_layer_corners, strip_edges
from app.halfspace.stress.stress_sums import FreeStress, OneWayStress, PeriodicStress


class LayeredPeriodicStress(PeriodicStress):
    """Stress below periodic patches of a layered body [N/mm2]."""

    def __init__(self, pressure, grid, layer):
        super().__init__(pressure, grid, layer.poisson[0])
        self.layer = layer
        half = np.arange(grid.ny // 2 + 1)  # waves of opposite rows have the same length
        qx, qy = wave_numbers(grid, np.arange(grid.nx // 2 + 1), half)
        self._layer_waves = LayerWaves(layer, np.hypot(qx, qy[:, None]))
        self._rows = abs(scipy.fft.fftfreq(grid.ny, 1 / grid.ny)).astype(int)

    def _functions(self, depth):
        nu = self.layer.poisson[int(depth > self.layer.thickness)]
        return *(f[self._rows] for f in self._layer_waves.functions(depth)), nu


class LayeredFreeStress(FreeStress):
    """Stress below free patches of a layered body [N/mm2]."""

    def __init__(self, pressure, grid, layer):
        super().__init__(pressure, grid, layer.poisson[0])
        self.layer = layer

    def _corners(self, x, y, depth):
        if depth <= self.layer.thickness:
            corners = super()._corners(x, y, depth)
        else:
            corners = np.zeros((6, y.size, x.size))
        add_layer_corners(self.layer, x, y, depth, corners)
        return corners


class LayeredOneWayStress(OneWayStress):
    """Stress below patches of a layered body, periodic in one direction [N/mm2]."""

    def __init__(self, pressure, grid, layer):
        self.layer = layer
        super().__init__(pressure, grid, layer.poisson[0])

    def _make_waves(self, pressure, grid):
        return LayeredPeriodicStress(pressure, grid, self.layer)

    def _strip_edges(self, x, depth):
        edges, below = strip_edges(self.layer, x, depth), depth > self.layer.thickness
        if not below:
            edges += super()._strip_edges(x, depth)[0]
        return edges, self.layer.poisson[int(below)]
