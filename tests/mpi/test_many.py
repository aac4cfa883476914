"""Many problems on several ranks: the numbers and the file of one rank."""

import h5py
import numpy as np
import pytest
from mpi4py import MPI

from app import Grid, InputError, Material, solve_many

GRID = Grid.from_domain(24, 16, (0.0, 1.0, 0.0, 1.0))
SURFACES = 1e-3 * np.random.default_rng(3).random((3, 16, 24))
pytestmark = [pytest.mark.mpi(2), pytest.mark.filterwarnings("ignore::app.NoteWarning")]


def solved(path, comm=None):
    material = Material.combined(80000.0, 0.3)
    return solve_many(SURFACES, [20, 30, 40], grid=GRID, material=material, output=path, comm=comm)


def test_table_and_file_are_those_of_one_rank(comm, tmp_path):
    table = solved(tmp_path / "together.h5")
    if comm.rank == 0:
        expected = solved(tmp_path / "alone.h5", MPI.COMM_SELF)
        for name in ("problem", "load", "approach", "max_pressure"):
            np.testing.assert_allclose(table[name], expected[name], rtol=1e-5)
        with h5py.File(tmp_path / "together.h5") as one, h5py.File(tmp_path / "alone.h5") as other:
            pressure = other["pressure"][()]
            np.testing.assert_allclose(one["pressure"], pressure, rtol=0, atol=1e-4 * pressure.max())


def test_a_folder_that_is_missing_is_an_error_on_all_ranks(comm, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        solved(tmp_path / "missing" / "fields.h5")


def test_several_processes_are_refused(comm):
    with pytest.raises(InputError, match="must be 1 under mpiexec with"):
        solve_many(SURFACES, 20, 2, grid=GRID, material=Material.combined(80000.0, 0.3))
