"""A contact law for finite elements: two bars that meet at rough faces.

The law of a rough patch is computed once, as a table with a proved solution at each point. A finite element program
interpolates it, with its derivative, as a nonlinear spring between the nodes of both faces.
"""

import matplotlib.pyplot as plt
import numpy as np

from app import ContactProblem, ContactSolver, Grid, Material, SelfAffineSurface

# %% The law of self-affine faces of glass.
young = 70e3  # N/mm2
grid = Grid.from_domain(128, 128, (0, 1, 0, 1))
rough = SelfAffineSurface(0.8, 0.25, 0.03, (1, 1), seed=1, rms_slope=0.02)
problem = ContactProblem(grid, Material.isotropic(young, 0.22), surfaces=[rough], periodic=True)
with ContactSolver(problem) as solver:
    law = solver.law(mean_pressure=(1, 200), tolerance=1e-3)
law.save("contact_law.csv")
print(law)

# %% Two bars with a section of 1 mm2, each of 10 elements in a row.
elements, length = 10, 1.0  # mm
nodes = elements + 1
bar = 2 * np.eye(nodes) - np.eye(nodes, k=1) - np.eye(nodes, k=-1)
bar[0, 0] = bar[-1, -1] = 1
bars = young * elements / length * np.kron(np.eye(2), bar)
faces = [nodes - 1, nodes]  # top of the lower bar, bottom of the upper one

# %% The lower end is fixed, the upper one is pushed down: Newton's method.
pushes, forces, u = np.linspace(1e-4, 5e-3, 30), [], np.zeros(2 * nodes)
for push in pushes:
    u[-1], step = -push, 1.0
    while np.abs(step).max() > 1e-12:
        interface = law.at(indentation=u[faces[0]] - u[faces[1]])
        residual, tangent = bars @ u, bars.copy()
        residual[faces] += interface["load"] * np.array([1, -1])
        tangent[np.ix_(faces, faces)] += interface["stiffness"] * np.array([[1, -1], [-1, 1]])
        step = np.linalg.solve(tangent[1:-1, 1:-1], residual[1:-1])
        u[1:-1] -= step
    forces.append(float(interface["load"]))
closing = float(interface["indentation"])
print(f"{forces[-1]:.1f} N at {1e3 * push:.3g} um, of which {1e3 * closing:.3f} um in the faces")

# %% The law, and the force with and without roughness.
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
curve = law.at(indentation=np.linspace(0, 1.1, 300) * law.table["indentation"][-1])
left.semilogy(1e3 * curve["indentation"], curve["load"], label="interpolated")
left.semilogy(1e3 * law.table["indentation"], law.table["load"], "k.", label="solved")
left.set(xlabel="closing of the gap from first touch [µm]", ylabel="load on 1 mm² [N]", ylim=(0.1, None))
left.legend()
right.plot(1e3 * pushes, forces, label="rough faces")
right.plot(1e3 * pushes, young / (2 * length) * pushes, "k--", label="smooth faces")
right.set(xlabel="displacement of the end [µm]", ylabel="force [N]")
right.legend()
figure.savefig("contact_law.png", dpi=50)
