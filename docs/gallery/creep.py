"""A rubber ball creeps, and so do rough surfaces.

A ball of rubber is pressed on a rigid plane by a constant load. Its contact grows with time, as Lee and Radok (1960)
have computed. The contact of a rough rubber surface grows, too, under a constant mean pressure.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface, Sphere

# %% A rubber with two relaxation times, on a rigid body.
rubber = Material.pair((10, np.inf), (0.5, 0.3)).viscoelastic(times=(0.1, 10), moduli=(0.3, 0.4))
times = np.concatenate([[0], np.geomspace(0.01, 100, 25)])
creep = rubber.creep.at(times)

# %% A ball under 1 N.
grid = Grid.from_domain(128, 128, (-2, 2, -2, 2))
with ContactSolver(ContactProblem(grid, rubber, Sphere(10))) as solver:
    path = solver.creep(times, load=1)
    ball = list(path)
area = path.table["contact_fraction_corrected"] * grid.area
radius = np.cbrt(3 * 1 * 10 / (4 * rubber.contact_modulus) * creep)
print(f"contact radius after {times[-1]:g} s: {np.sqrt(area[-1] / np.pi):.3f} mm, exact {radius[-1]:.3f} mm")

# %% A rough surface under a mean pressure of 0.05 N/mm2.
patch = Grid.from_domain(128, 128, (0, 1, 0, 1))
rough = SelfAffineSurface(0.8, 0.25, 0.06, (1, 1), seed=1, rms_slope=0.1)
with ContactSolver(ContactProblem(patch, rubber, surfaces=[rough], periodic=True)) as solver:
    rough_path = solver.creep(times, mean_pressure=0.05)
    first, *_, last = rough_path
fraction = rough_path.table["contact_fraction"]

# %% Growth of the contact, the pressure of the ball, and contact spots.
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.4), layout="constrained")
shown = slice(1, None)
left.semilogx(times[shown], area[shown] / area[0], "o", markersize=4, label="ball")
left.semilogx(times[shown], creep[shown] ** (2 / 3), "k--", label="ball, Lee and Radok")
left.semilogx(times[shown], fraction[shown] / fraction[0], "s", markersize=4, label="rough surface")
left.set(xlabel="time [s]", ylabel="contact area / first contact area")
left.legend()
for step in (0, 9, 17, 25):
    solution = ball[step]
    middle.plot(solution.x, solution.pressure[grid.ny // 2], label=f"{times[step]:.3g} s")
middle.set(xlabel="x [mm]", ylabel="pressure of the ball [N/mm2]", xlim=(-1.5, 1.5), ylim=(0, None))
middle.legend()
spots = first.contact.astype(int) + last.contact
right.imshow(spots, origin="lower", extent=(0, 1, 0, 1), cmap="Blues")
right.set(xlabel="x [mm]", ylabel="y [mm]", title=f"rough contact at 0 s (dark) and {times[-1]:g} s")
figure.savefig("creep.png", dpi=60)
