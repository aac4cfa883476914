"""Repair of fluxes, so that no cell gains or loses fluid.

What a cell gains is sent along a spanning tree of the cells to the sides of the patch where the pressure is given, or
to another cell that loses as much. The tree has the faces of the largest conductances (Kruskal), because fluid sent
through narrow faces makes the lower bound of the flow rate small. Each rank has a tree of its own cells. Parts that are
connected only through other ranks exchange fluid along a second tree, whose nodes are the parts; all ranks compute it.
"""

import numpy as np

from app.base.numba_cache import njit
from app.flow.network import ROUNDING, neighbours


@njit()
def _find(root, node):
    while root[node] != node:
        root[node] = root[root[node]]
        node = root[node]
    return node


@njit()
def _select_forest(first, second, order, root, degree, incident):
    """Select the faces of a spanning forest, in the given order.

    `degree` becomes the number of a node's selected faces, `incident` the exclusive or of their numbers. At the end
    `root` has equal numbers in each tree.
    """
    for face in order:
        a, b = first[face], second[face]
        one, other = _find(root, a), _find(root, b)
        if one != other:
            root[one] = other
            degree[a] += 1
            degree[b] += 1
            incident[a] ^= face
            incident[b] ^= face
    for node in range(root.size):
        root[node] = _find(root, node)


@njit()
def _drain(first, second, degree, incident, excess, flux):
    """Send the excess of all nodes along a forest, leaves first.

    The flux goes from `first` to `second`. The last node of a tree keeps the excess of the tree; it is node 0 in the
    tree of node 0. `degree` and `incident` are used up.
    """
    for start in range(1, degree.size):
        node = start
        while degree[node] == 1 and node != 0:
            face = incident[node]
            other = first[face] ^ second[face] ^ node
            flux[face] += excess[node] if first[face] == node else -excess[node]
            excess[other] += excess[node]
            excess[node] = 0.0
            degree[node] = 0
            degree[other] -= 1
            incident[other] ^= face
            node = other


class _Forest:
    """Spanning forest of the largest conductances.

    Face k connects the nodes ``first[k]`` and ``second[k]``. Only faces whose conductance is at least `lowest` (and not
    0) are used. A tree that reaches node 0 ends there; what this node gets is let out.
    """

    def __init__(self, first, second, conductance, lowest, nodes):
        self._faces, self.root = (first, second), np.arange(nodes)
        used = np.flatnonzero((conductance >= lowest) & (conductance > 0))
        # Nearly the right order, in half the time: numpy sorts short integers by radix, and neighbours stay together.
        octaves = (-np.log2(conductance[used])).astype(np.int16)
        order = used[np.argsort(octaves, kind="stable")]
        self._degree, self._incident = np.zeros((2, nodes), np.int64)
        _select_forest(first, second, order, self.root, self._degree, self._incident)

    def drain(self, excess):
        """Return the fluxes that drain the `excess` of the nodes, which is overwritten."""
        flux = np.zeros(len(self._faces[0]))
        _drain(*self._faces, self._degree.copy(), self._incident.copy(), excess, flux)
        return flux


class FluxRepair:
    """Correction of the fluxes of a `Network`. Collective.

    It is also that of other networks with the same conductances. No fluid flows through faces whose conductance is less
    than `lowest`.
    """

    def __init__(self, network, lowest):
        self.lowest, (rows, nx) = lowest, network.is_open.shape
        # Node 0 is beyond the sides.
        pairs = neighbours(network.pad(np.arange(1, rows * nx + 1).reshape(rows, nx)))
        first, second = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in range(2))
        in_x, in_y = (conductance.copy() for conductance in network.conductances)
        in_x[:, -1] *= not network.repeats_x  # they are the first faces
        in_y[[0, -1]] *= ~np.array(network.linked)[:, None]
        self._split, conductance = in_x.size, np.concatenate([in_x.ravel(), in_y.ravel()])
        self._local = _Forest(first, second, conductance, lowest, rows * nx + 1)
        self._connect_parts(network)

    def _connect_parts(self, network):
        """Make the forest that connects the trees of all ranks, by the faces between their rows. Collective."""
        root, nx = self._local.root, network.grid.nx
        self._start = network.slabs.rows.start * nx  # of the numbers of this rank's parts
        parts = np.where(root == root[0], 0, root + self._start)[1:].reshape(-1, nx)
        before, conductance = network.halo(parts)[0], network.conductances[1][0]
        column = np.flatnonzero((conductance >= self.lowest) & (conductance > 0)) if len(before) else []
        faces = [(before[0, i], parts[0, i], conductance[i], self._start + i) for i in column]
        faces = [face for part in network.allgather(faces) for face in part]
        one, other, conductance, place = np.array(faces).reshape(-1, 4).T
        self._places = place.astype(np.int64)
        self._names, ends = np.unique(np.int64([0, *one, *other]), return_inverse=True)
        self._between = _Forest(*ends[1:].reshape(2, -1), conductance, self.lowest, len(self._names))

    def conserving_fluxes(self, network, pressure):
        """Return conserving fluxes close to those of a pressure, and a bound. Collective.

        The bound is a lower one of the flow rate. After the repair only rounding errors are left of the excess of a
        cell, which the flux `rest` would drain. By Cauchy and Schwarz's inequality, the root of the dissipation of the
        exactly conserving flux is at most the sum of both roots. Twice the second one also covers the rounding of the
        excess itself.
        """
        fluxes = network.fluxes(pressure)
        for flux, conductance in zip(fluxes, network.conductances, strict=True):
            flux[conductance < self.lowest] = 0.0
        self._drain(network, network.excess(fluxes), *fluxes)
        excess, rest = network.excess(fluxes), [np.zeros_like(flux) for flux in fluxes]
        rounding = network.sum(np.abs(excess).sum())
        self._drain(network, excess, *rest)
        root = np.sqrt(network.dissipation(fluxes)) + 2 * np.sqrt(network.dissipation(rest))
        rate = max(abs(network.rate(fluxes)) - rounding, 0.0)
        return fluxes, (rate / root) ** 2 * (1 - ROUNDING) if root > 0 else 0.0

    def _drain(self, network, excess, flux_x, flux_y):
        """Change fluxes so that the `excess` of all cells vanishes. Collective."""
        slabs, nx = network.slabs, network.grid.nx
        if len(self._places):
            sums = np.bincount(self._local.root, np.append(0.0, excess.ravel()))
            own = self._names - self._start
            total = np.array([sums[part] if 0 < part < len(sums) else 0.0 for part in own])
            through = self._between.drain(np.sum(network.allgather(total), axis=0))
            ends = (slabs.rows.start, 0, 1), (slabs.rows.stop % slabs.ny, -1, -1)
            for number, at, sign in ends if slabs.local else ():
                here = self._places // nx == number
                column = self._places[here] % nx
                flux_y[at, column] += through[here]
                excess[at, column] += sign * through[here]
        flux = self._local.drain(np.append(0.0, excess.ravel()))
        flux_x += flux[: self._split].reshape(flux_x.shape)
        flux_y += flux[self._split :].reshape(flux_y.shape)
        if network.repeats_x:
            flux_x[:, -1] = flux_x[:, 0]
