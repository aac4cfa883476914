"""A map of heights in files of several formats."""

import h5py
import numpy as np

NY, NX = 12, 15
DX, DY = 0.4, 0.5  # um
X, Y = DX * (np.arange(NX) + 0.5), DY * (np.arange(NY) + 0.5)[:, None]
HEIGHTS = np.random.default_rng(5).normal(size=(NY, NX))  # um


def save_text(path, heights):
    np.savetxt(path, heights, fmt="%.17g", delimiter=";")


def save_points(path, heights):
    """In no order; missing points are left out."""
    points = np.stack(np.broadcast_arrays(7 + X, Y - 3, heights), -1).reshape(-1, 3)
    points = points[~np.isnan(points[:, 2])]
    np.savetxt(path, np.random.default_rng(1).permutation(points), fmt="%.9f %.9f %.17g")


def save_converted(path, heights):
    with h5py.File(path, "w") as file:
        file["heights"], file["mask"] = heights, np.isnan(heights)
        file["heights"].attrs.update(unit="um", spacing=(1e3 * DX, 1e3 * DY), spacing_unit="nm")


def save_gwyddion(path, heights):
    """As its ASCII export is; in a micro sign that is a Greek letter."""
    ny, nx = heights.shape
    sides = f"Width: {nx * DX:.1f} \u03bcm\nHeight: {1e3 * ny * DY:.1f} nm"
    np.savetxt(path, heights, "%.17g", "\t", header=f"Channel: Z\n{sides}\nValue units: µm", encoding="utf-8")


FORMATS = {
    "s.npy": np.save, "s.csv": save_text, "s.xyz": save_points, "s.h5": save_converted, "s.txt": save_gwyddion
}  # fmt: skip
TOLD = ("s.h5", "s.txt")  # with their units  # formats
