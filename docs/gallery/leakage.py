"""Leakage through the gap of two rough surfaces.

A seal is pressed on a rough metal face. Fluid flows through the gap that is left, by Reynolds' equation: the flux is
-gap^3 / (12 viscosity) grad p. If the contact spots join, the flow stops (percolation).
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface


def flow(gap, lowest=1e-7):
    """Return fluid pressure, and flux over that of a gap of 1 mm, for unit pressures left and right."""
    conductance = np.maximum(gap, lowest) ** 3
    ny, nx = gap.shape
    cell = np.arange(gap.size).reshape(ny, nx)
    mean = lambda a, b: 2 * a * b / (a + b)  # noqa: E731  of two cells in series
    faces = [
        (cell[:, :-1], cell[:, 1:], mean(conductance[:, :-1], conductance[:, 1:])),
        (cell, np.roll(cell, -1, axis=0), mean(conductance, np.roll(conductance, -1, axis=0))),
    ]
    i, j, k = (np.concatenate([face[m].ravel() for face in faces]) for m in range(3))
    left, right = 2 * conductance[:, 0], 2 * conductance[:, -1]  # to the sides of the patch
    diagonal = np.bincount(i, k, gap.size) + np.bincount(j, k, gap.size)
    diagonal[cell[:, 0]] += left
    diagonal[cell[:, -1]] += right
    inflow = np.zeros(gap.size)
    inflow[cell[:, 0]] = left
    own = cell.ravel()
    data, rows, columns = np.r_[diagonal, -k, -k], np.r_[own, i, j], np.r_[own, j, i]
    p = spsolve(coo_matrix((data, (rows, columns))).tocsc(), inflow).reshape(ny, nx)
    return p, float(right @ p[:, -1]) * nx / ny


# %% A rubber seal on a rough face, periodic in x and y.
grid = Grid.from_domain(128, 128, (0, 1, 0, 1))
face = SelfAffineSurface(0.8, 0.25, 0.06, (1, 1), seed=4, rms_slope=0.1)
problem = ContactProblem(grid, Material.pair((10, np.inf), (0.5, 0.3)), surfaces=[face], periodic=True)
mean_pressures, fluxes = np.linspace(0.04, 0.36, 9), []
with ContactSolver(problem) as solver:
    solutions = list(solver.path(mean_pressure=mean_pressures))
for solution in solutions:
    _, flux = flow(np.where(solution.contact, 0, solution.gap))
    fluxes.append(flux)
    print(f"{solution.mean_pressure:.2f} N/mm2: {solution.contact_fraction:.1%} in contact, flux {flux:.3g}")

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
left.semilogy(mean_pressures, fluxes, "o-")
left.set(xlabel="mean pressure [N/mm²]", ylabel="flux over that of a gap of 1 mm", ylim=(1e-13, None))
solution = solutions[2]
p, _ = flow(np.where(solution.contact, 0, solution.gap))
picture = right.imshow(np.where(solution.contact, np.nan, p), origin="lower", extent=(0, 1, 0, 1))
figure.colorbar(picture, label=f"fluid pressure at {solution.mean_pressure:.2f} N/mm² (white: contact)")
right.set(xlabel="x [mm]", ylabel="y [mm]")
figure.savefig("leakage.png", dpi=50)
