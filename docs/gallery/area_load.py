"""Contact area against load of a rough surface, on finer and finer grids: a figure of many papers.

The law of the literature: at light loads the area is kappa times the load over E* times the rms slope. Persson's
theory has kappa = sqrt(8/pi) = 1.6, that of Bush, Gibson and Thomas sqrt(2 pi) = 2.5; computations find 2 to
sqrt(2 pi). The area of the cells depends on their size. The corrected area, which uses the perimeter, hardly does.

    python area_load.py          # up to 512 x 512 cells
    python area_load.py 8192
"""

import sys
import time

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

# %% One periodic surface with waves of 0.2 to 0.025 mm, twelve loads.
largest = int(sys.argv[1]) if len(sys.argv) > 1 else 512
sizes = [128 * 2**level for level in range(7) if 128 * 2**level <= largest]
surface = SelfAffineSurface(0.8, 0.2, 0.025, (1, 1), seed=1, rms_slope=0.1)
steel = Material.isotropic(210e3, 0.3)
relative = np.geomspace(0.005, 0.5, 12)  # mean pressure / (E* rms slope)

# %% All loads on each grid.
tables = {}
for size in sizes:
    started = time.perf_counter()
    grid = Grid.from_domain(size, size, (0, 1, 0, 1), periodic=True)
    with ContactSolver(ContactProblem(grid, steel, surfaces=[surface])) as solver:
        path = solver.path(mean_pressure=relative * steel.contact_modulus * surface.rms_slope)
        for _ in path:
            pass
    tables[size] = path.table
    kappa = path.table["contact_fraction_corrected"][:3].mean() / relative[:3].mean()
    print(f"{size} x {size}: kappa {kappa:.3f}, 12 loads in {time.perf_counter() - started:.1f} s")

# %% Area against load on the finest grid, and the quotient on all grids.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
finest = tables[sizes[-1]]
left.loglog(relative, finest["contact_fraction_corrected"], "ko", label=f"computed, {sizes[-1]}² cells")
left.loglog(relative, finest["persson_fraction"], label="Persson")
left.loglog(relative, finest["bush_gibson_thomas_fraction"], "--", label="Bush, Gibson, Thomas")
left.set(xlabel="mean pressure / (E* rms slope)", ylabel="contact fraction")
left.legend()
for place, (size, table) in enumerate(tables.items()):
    color = plt.cm.viridis(place / len(tables))
    right.semilogx(relative, table["contact_fraction"] / relative, ":", color=color)
    right.semilogx(
        relative, table["contact_fraction_corrected"] / relative, "o-", color=color, label=f"{size}²", ms=4
    )
right.axhspan(2, np.sqrt(2 * np.pi), color="0.9", label="kappa of the literature")
right.semilogx(relative, finest["persson_fraction"] / relative, "k--", label="Persson")
right.set(xlabel="mean pressure / (E* rms slope)", ylabel="contact fraction / abscissa (dotted: cells)")
right.legend()
figure.savefig("area_load.png", dpi=50)
