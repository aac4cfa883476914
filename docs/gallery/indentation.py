"""Indentation with unloading and residual depth.

A ball of 10 mm diameter is pressed on a steel plate of hardness 2000 N/mm2, and removed. No pressure exceeds the
hardness, so the plate keeps an indentation. Loads that fall unload the indented plate elastically.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, EllipticHertz, Grid, Material, Sphere

# %% A ball of tungsten carbide on steel.
pair = Material.pair((600e3, 210e3), (0.22, 0.3))
grid = Grid.from_domain(256, 256, (-0.9, 0.9, -0.9, 0.9))
problem = ContactProblem(grid, pair, Sphere(5), hardness=2000)

# %% Load to 3000 N, unload to 0, and load again to 4000 N.
up, down = 3000 * np.linspace(0, 1, 13) ** 1.5, 3000 * np.linspace(1, 0, 13) ** 1.5
with ContactSolver(problem) as solver:
    path = solver.path(load=[*up[1:], *down[1:], *up[3::3], 4000], stiffness=True)
    solutions = list(path)
table, loaded, unloaded = path.table, solutions[11], solutions[23]
indentation = loaded.residual_surface()
area, modulus = loaded.contact_area, pair.contact_modulus
print(
    f"loaded: approach {1e3 * loaded.approach:.2f} µm, plastic area {loaded.plastic_area:.3f} of {area:.3f} mm2"
)
print(
    f"unloaded: approach {1e3 * unloaded.approach:.2f} µm, residual depth {1e3 * indentation.depth.max():.2f} µm"
)
oliver_pharr = 2 * modulus * np.sqrt(area / np.pi)
print(
    f"unloading stiffness {loaded.unloading_stiffness:.4g} N/mm, 2 E* sqrt(A / pi) = {oliver_pharr:.4g} N/mm"
)

# %% Load and approach, and Hertz's elastic contact.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
for steps, style, label in (
    (slice(0, 12), "o-", "loading"),
    (slice(11, 24), "s-", "unloading"),
    (slice(23, None), "^:", "loading again"),
):
    left.plot(1e3 * table["approach"][steps], table["load"][steps], style, markersize=4, label=label)
elastic = [EllipticHertz.from_load(5, 5, modulus, load).approach for load in up[1:]]
left.plot(1e3 * np.array(elastic), up[1:], "k--", label="without a hardness (Hertz)")
tangent = loaded.approach - np.array([0, 0.9 * 3000 / loaded.unloading_stiffness])
left.plot(1e3 * tangent, [3000, 300], "k:", label="unloading stiffness")
left.set(xlabel="approach [µm]", ylabel="load [N]", ylim=(0, None))
left.legend()

# %% The plate after unloading, and the ball, which only touches it now.
depth, middle = 1e3 * indentation.depth, grid.ny // 2
ball = 1e3 * (Sphere(5).shape_on(grid)[middle] - unloaded.approach)
right.fill_between(grid.x(), -depth[middle], -60, color="0.85")
right.plot(grid.x(), -depth[middle], "k", label="plate, unloaded")
right.plot(grid.x(), ball, "--", label="ball, unloaded")
right.annotate(f"residual depth {depth.max():.1f} µm", (0, -depth.max()), (0, -53), ha="center")
right.set(xlabel="x [mm]", ylabel="height [µm]", ylim=(-60, 25), xlim=(-0.9, 0.9))
right.legend(loc="upper center")
figure.savefig("indentation.png", dpi=60)
