"""Two bodies, given by their radii: a crowned gear tooth on another one, with axes at an angle.

Every smooth body has two principal radii where it touches: inf is straight, negative is concave. The program adds the
curvatures of both bodies and turns the patch along the axes of the contact ellipse.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, Material, Paraboloid, fit_grid, solve

steel_on_bronze = Material.pair((210e3, 110e3), (0.3, 0.34))
figure, panels = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")

# %% The same two bodies, turned about the normal.
for axes, angle in zip(panels, (0, 30, 90), strict=True):
    shape = Paraboloid.between((15, 400), (25, np.inf), angle)
    grid = fit_grid(shape, steel_on_bronze, cells=128, load=500)
    solution = solve(ContactProblem(grid, steel_on_bronze, shape), load=500)
    exact = shape.analytic(steel_on_bronze.contact_modulus, load=500)
    print(
        f"{angle:2} degrees: relative radii {shape.rx:.4g} and {shape.ry:.4g} mm, maximum pressure "
        f"{solution.max_pressure:.1f}, by Hertz {exact.max_pressure:.1f} N/mm2, semi-axes "
        f"{solution.semi_axis_minor:.4f} and {solution.semi_axis_major:.4f} mm"
    )
    solution.plot("pressure", ax=axes)
    axes.set_title(f"axes at {angle}°")
figure.savefig("two_bodies.png", dpi=50)
