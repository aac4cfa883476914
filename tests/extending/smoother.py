# tests/extending/smoother.py
import numpy as np
from petsc4py import PETSc


class SymmetricSweeps:
    """PC: a sweep forward, then one backward; option -pc_sweeps_omega (default 0.8)."""

    def setFromOptions(self, pc):
        self.omega = PETSc.Options(pc.getOptionsPrefix()).getReal("pc_sweeps_omega", 0.8)

    def setUp(self, pc):
        self.operator = pc.getOperators()[1].getPythonContext()

    def apply(self, pc, x, y):
        operator, mask = self.operator, self.operator.mask
        first, second, u = np.zeros((3, *operator.local_shape))
        r = x.getArray(readonly=True).reshape(operator.local_shape) * mask
        operator.relaxation.sweep(r, mask, self.omega, first)
        operator.product.apply(first, u, mask)
        operator.relaxation.sweep(r - u, mask, self.omega, second, backward=True)
        y.setArray((first + second).reshape(-1))
        operator.sweeps += 2  # counted in the paper's work units
