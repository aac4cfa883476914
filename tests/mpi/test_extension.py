"""Extension over the rim on several ranks against one: ``mpiexec -n 3 python tests/mpi_extension.py``."""

import numpy as np
from mpi4py import MPI

from app.halfspace.grid import Slabs
from app.multigrid.extension import RimExtension

STENCIL = [[-0.037, -0.161, -0.037], [-0.189, 1.0, -0.189], [-0.037, -0.161, -0.037]]
SHAPES = [
    (32, 20),
    (13, 7),
    (5, 9),
    (2, 6),
    (1, 8),
    (9, 1),
]  # slabs thinner than the band; ranks without rows


def check(comm, shape, block, density, steps, dtype):
    """Both operators give this rank its rows of what one rank alone finds, to the last bit."""
    rng = np.random.default_rng([*shape, block, steps, int(100 * density)])
    slabs = Slabs(shape[0], comm.size, comm.rank, block)
    alone = RimExtension(shape, None, None, steps)
    here = RimExtension((slabs.local, shape[1]), slabs, comm, steps)
    for extension in (alone, here):
        extension.set_stencil(STENCIL)
    for _ in range(2):  # the second contact set replaces the first
        contact = rng.random(shape) < density
        alone.set_contact(contact)
        here.set_contact(contact[slabs.rows].copy())
        field = rng.normal(size=shape).astype(dtype)

        expected = field * contact
        found = expected[slabs.rows].copy()
        alone.extend(expected)
        here.extend(found)
        np.testing.assert_array_equal(found, expected[slabs.rows])

        expected, found = field.copy(), field[slabs.rows].copy()
        alone.restrict(expected)
        here.restrict(found)
        mine = contact[slabs.rows]
        np.testing.assert_array_equal(found[mine], expected[slabs.rows][mine])


if __name__ == "__main__":
    comm = MPI.COMM_WORLD
    for shape in SHAPES:
        for block in (1, 4):
            for density in (0.0, 0.05, 0.4, 1.0):
                for steps in (0, 1, 3):
                    check(comm, shape, block, density, steps, np.float64)
    check(comm, (24, 24), 1, 0.2, 3, np.float32)
    if comm.rank == 0:
        print(f"passed on {comm.size} ranks")
