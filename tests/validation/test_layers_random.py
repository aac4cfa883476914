"""Random layered problems, against dense solutions whose matrix is computed independently of the kernels.

S of `app.halfspace.layer` is evaluated as printed, in extended precision. On free patches, its part of a coefficient is
an integral over the plane of wave numbers; on periodic ones, it is a Fourier sum.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from app import ContactProblem, InputError, Material
from app.halfspace.influence import dense_matrix
from app.verification import dense
from app.verification.solving import methods, random_problem, solved

LARGEST_WAVE = 17.0  # q t, beyond which S - 1 does not count


def ratio(x, young, poisson):
    """S as printed in docs/layers.md."""
    nu1, nu2 = map(np.longdouble, poisson)
    x, mu = np.asarray(x, np.longdouble), (young[0] / (1 + nu1)) / (np.longdouble(young[1]) / (1 + nu2))
    lam, kappa = 1 - 4 * (1 - nu1) / (1 + mu * (3 - 4 * nu2)), (mu - 1) / (mu + 3 - 4 * nu1)
    th = np.exp(-2 * x)
    top = 1 + 4 * x * kappa * th - lam * kappa * th**2
    return top / (1 - (lam + kappa + 4 * kappa * x**2) * th + lam * kappa * th**2)


def free_part(grid, young, poisson, t):
    """Integrals over cells of the influence of a layer minus that of a half-space, for unit compliance."""
    dx, dy = grid.dx / t, grid.dy / t
    x, y = dx * np.arange(grid.nx), dy * np.arange(grid.ny)
    radius = np.hypot(grid.nx * dx, grid.ny * dy)
    step = min(0.5, 6 / radius)
    edges = np.concatenate(
        [[0], np.geomspace(1e-5, step, 14), np.arange(2 * step, LARGEST_WAVE + step, step)]
    )
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = np.zeros(grid.shape)
    for low, high in pairwise(edges):
        q = (low + high) / 2 + (high - low) / 2 * nodes[:, None]
        angles = int(0.6 * high * radius + 24)
        angle = (np.arange(angles) + 0.5) * np.pi / (2 * angles)
        qx, qy = (q * np.cos(angle)).ravel(), (q * np.sin(angle)).ravel()
        excess = ((high - low) / 2 * weights * (ratio(q[:, 0], young, poisson) - 1)).astype(float) / angles
        form = np.repeat(excess, angles) * np.sinc(qx * dx / 2 / np.pi) * np.sinc(qy * dy / 2 / np.pi)
        total += np.cos(np.outer(y, qy)) @ (form[:, None] * np.cos(np.outer(qx, x)))
    return dx * dy * t * total


def periodic_part(grid, young, poisson, t):
    """The same on a periodic patch, by sums over waves and their aliases."""
    i, j = (np.fft.fftfreq(n) * n for n in (grid.nx, grid.ny))
    counts = (int(22 / t * d / (2 * np.pi)) + 2 if grid.periodic == "love" else 0 for d in (grid.dx, grid.dy))
    ax, ay = (np.arange(-count, count + 1) for count in counts)
    kx, ky = i + grid.nx * ax[:, None, None, None], j[:, None] + grid.ny * ay[:, None, None]
    q = 2 * np.pi * np.hypot(kx / (grid.nx * grid.dx), ky / (grid.ny * grid.dy)).astype(np.longdouble)
    q[q == 0] = np.inf
    terms = 2 * np.pi * (ratio(np.minimum(q * t, 1e3), young, poisson) - 1) / q
    if grid.periodic == "love":
        terms *= np.sinc(kx / grid.nx) * np.sinc(ky / grid.ny)
    symbol = terms.sum(axis=(0, 1))
    symbol[0, 0] = 0
    return np.fft.ifft2(symbol.astype(float)).real


def own_matrix(grid, half_space, layers):
    """A of half-spaces of the surface materials, plus the parts of the layers."""
    matrix = dense.long_matrix(grid, half_space.kernel)
    j, i = np.arange(grid.ny), np.arange(grid.nx)
    dj, di = abs(j[:, None] - j)[:, None, :, None], abs(i[:, None] - i)[None, :, None, :]
    for young, poisson, t in layers:
        part = (periodic_part if grid.periodic else free_part)(grid, young, poisson, t)
        matrix = matrix + (1 - poisson[0] ** 2) / (np.pi * young[0]) * part[dj, di].reshape(grid.n, grid.n)
    return matrix


def draw_layer(rng, cell, thinnest):
    """Moduli, Poisson's ratios and thickness."""
    nu, young = rng.choice([0, 0.3, 0.45, 0.49, 0.5]), 10 ** rng.uniform(-1, 1)
    thickness = cell * 10 ** rng.uniform(np.log10(thinnest), 2)
    if rng.random() < 0.4:
        return (young, np.inf), (nu, 0.0), thickness
    other = rng.choice([0, 0.3, 0.5])
    return (young, young / 10 ** rng.uniform(-2, 2)), (nu, other), thickness


@pytest.mark.parametrize("seed", range(45))
def test_random_layers_equal_dense_solutions(seed, monkeypatch):
    """With one layer or two, holes, a hardness, all loadings and methods."""
    rng = np.random.default_rng(seed)
    nx, ny = rng.choice([1, 2, 3, 5, 6, 7, 9, 10, 11], 2)
    problem = random_problem(rng, nx, ny, ["", "spectral", "love"][seed % 3])
    grid, gap = problem.grid, problem.gap
    cell = np.sqrt(grid.dx * grid.dy)
    thinnest = 0.1 if grid.periodic else 1.0  # in cells; integrals for thinner layers take long
    layers, other = [draw_layer(rng, cell, thinnest) for _ in range(rng.integers(1, 3))], (np.inf, 0.0)
    if len(layers) == 1 and rng.random() < 0.5:
        other = 10 ** rng.uniform(-1, 1), 0.3
    second = Material.coated(*layers[1]) if len(layers) == 2 else other
    surface = (layers[1][0][0], layers[1][1][0]) if len(layers) == 2 else other
    material = Material.coated(*layers[0], other=second)
    problem = ContactProblem(grid, material, gap)
    half_space = Material.pair((layers[0][0][0], surface[0]), (layers[0][1][0], surface[1]))
    matrix = own_matrix(grid, half_space, layers)
    difference = dense_matrix(grid, material.kernel) - matrix.astype(float)
    assert abs(difference).max() <= 1e-9 * abs(matrix).max()

    monkeypatch.setattr(dense, "long_matrix", lambda *_: matrix)
    least, mean = np.nanmin(gap), np.nanmean(gap)
    approach = least + rng.uniform(0.05, 0.95) * (mean - least)
    p, capped = dense.DenseProblem(problem).at(approach), rng.random() < 0.3
    if capped:
        problem = replace(problem, hardness=float(p.max()) * rng.uniform(0.2, 0.9))
        p = dense.DenseProblem(problem).at(approach)
    p, uniform = p.astype(float), material.kernel.uniform_compliance(grid)
    values = {"load": p.sum() * grid.cell_area, "approach": approach + uniform * p.mean()}
    if capped and uniform:
        del values["approach"]
    loading = rng.choice(list(values))
    every = [None, *methods(grid.periodic)]
    method = every[rng.integers(len(every))] if rng.random() < 0.3 else None
    options = {"lcp_rtol": 1e-8, "lcp_precision": "double"}
    try:
        solution = solved(problem, method, options=options, **{loading: values[loading]})
    except InputError as refusal:
        assert "3 times its thickness" in str(refusal)
        return
    assert solution.converged
    error = (solution.pressure - p).ravel()
    energy = [np.sqrt(max(v @ matrix.astype(float) @ v, 0.0)) for v in (error, p.ravel())]
    eigenvalues, waves = np.linalg.eigh(matrix.astype(float))
    good = eigenvalues > 1e-12 * eigenvalues[-1]
    of_matrix = (
        waves.T[good] @ (difference @ p.ravel()) / np.sqrt(eigenvalues[good])
    )  # error by that of the matrix
    assert (
        energy[0]
        <= 1.001 * solution.error_bound * energy[1] + 2 * np.linalg.norm(of_matrix) + 1e-13 * energy[1]
    )
    assert abs(error).max() <= 1e-4 * p.max()
