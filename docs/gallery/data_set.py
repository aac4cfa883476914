"""A data set: thousands of rough contacts, for statistics or for learning.

Each sample has a Hurst exponent, an rms slope, a seed and a mean pressure of its own. Two processes solve the samples.
The numbers of all samples go to a Parquet file, numbers and contact maps to a netCDF file, both with units.

    python data_set.py           # 40 samples
    python data_set.py 4500      # as many as you like
"""

import sys
import time

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pyarrow
from pyarrow import parquet

from app import Grid, Material, SelfAffineSurface, solve_many

# %% The random inputs of the samples; patches of 1 x 1 mm, 512 x 512 cells.
samples = int(sys.argv[1]) if len(sys.argv) > 1 else 40
rng = np.random.default_rng(1)
hurst, slope = rng.uniform(0.4, 1, samples), rng.uniform(0.05, 0.2, samples)
steel = Material.isotropic(210e3, 0.3)
pressure = 10 ** rng.uniform(-2.3, -0.3, samples) * steel.contact_modulus * slope
surfaces = [
    SelfAffineSurface(h, 0.25, 8 / 512, (1, 1), seed, rms_slope=s)
    for seed, (h, s) in enumerate(zip(hurst, slope, strict=True))
]

if __name__ == "__main__":  # the processes import this file
    # %% Solve on two processes; the maps go to a file.
    grid = Grid.from_domain(512, 512, (0, 1, 0, 1), periodic=True)
    started = time.perf_counter()
    table = solve_many(
        surfaces,
        processes=2,
        mean_pressure=pressure,
        grid=grid,
        material=steel,
        output="maps.h5",
        fields=["contact"],
    )
    seconds = time.perf_counter() - started
    print(
        f"{samples} samples in {seconds:.0f} s, {1e3 * seconds / samples:.0f} ms each; solved: {table.converged}"
    )

    # %% Numbers with units: Parquet has them in the metadata of its columns, netCDF in attributes.
    frame = table.to_dataframe().assign(hurst=hurst, rms_slope=slope, seed=range(samples))
    units = frame.attrs["units"] | {"hurst": "1", "rms_slope": "1", "seed": "1"}
    columns = pyarrow.Table.from_pandas(frame)
    schema = [field.with_metadata({"units": units.get(field.name, "")}) for field in columns.schema]
    parquet.write_table(columns.cast(pyarrow.schema(schema, columns.schema.metadata)), "data_set.parquet")

    data = frame.rename_axis("sample").to_xarray().assign_coords(x=grid.x(), y=grid.y())
    with h5py.File("maps.h5") as maps:
        data["contact"] = ("sample", "y", "x"), maps["contact"][:]
    for name, unit in (units | {"x": "mm", "y": "mm", "contact": "1"}).items():
        data[name].attrs["units"] = unit
    data.to_netcdf("data_set.nc", engine="h5netcdf", encoding={"contact": {"zlib": True}})

    # %% The contact fraction of all samples, and one of the maps.
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
    relative = pressure / (steel.contact_modulus * slope)
    points = left.scatter(relative, table["contact_fraction_corrected"], c=hurst, s=12)
    left.set(xscale="log", yscale="log", xlabel="mean pressure / (E* rms slope)", ylabel="contact fraction")
    figure.colorbar(points, label="Hurst exponent")
    middle = int(np.argsort(relative)[samples // 2])
    right.imshow(data["contact"][middle], origin="lower", extent=(0, 1, 0, 1), cmap="Greys")
    right.set(title=f"contact of sample {middle}", xlabel="x [mm]", ylabel="y [mm]")
    figure.savefig("data_set.png", dpi=50)
