# tests/extending/preconditioner.py
import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import uniform_filter


class Waves:
    """PC: C F^-1 |q| F C, F the cosine transform of the rows of this rank."""

    operator = None

    def setUp(self, pc):
        operator = pc.getOperators()[1].getPythonContext()
        if operator is not self.operator:  # PETSc calls setUp for every contact set
            self.operator, (rows, nx), grid = operator, operator.local_shape, operator.grid
            qx = np.pi * (np.arange(nx) + 0.5) / (nx * grid.dx)
            qy = np.pi * (np.arange(rows) + 0.5) / (max(rows, 1) * grid.dy)
            self.q = np.hypot(qx, qy[:, None])

    def apply(self, pc, x, y):
        mask = self.operator.mask
        r = x.getArray(readonly=True).reshape(mask.shape) * mask
        if r.size:
            r = mask * idctn(self.q * dctn(r, norm="ortho"), norm="ortho")
        y.setArray(r.reshape(-1))

    def extend(self, r):
        mask = self.operator.mask
        near = uniform_filter(mask.astype(float), 3, mode="constant")  # share of the 3 x 3 cells that is in C
        mean = uniform_filter(r, 3, mode="constant") / np.maximum(near, 1 / 9)
        np.copyto(r, mean, where=~mask & (near > 0))
