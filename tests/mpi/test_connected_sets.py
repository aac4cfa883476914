"""Connected sets of contact that cross ranks."""

import numpy as np
import pytest

from app.halfspace.connected_sets import label_connected_sets
from app.parallel.slabs import Slabs


@pytest.mark.mpi(2, 3)
def test_connected_sets_are_independent_of_ranks(comm):
    for shape in ((13, 17), (2, 9)):
        for symbol in ("", "spectral"):
            contact, periodic = np.random.default_rng(1).random(shape) < 0.55, bool(symbol)
            slabs = Slabs.over(comm, shape[0])
            labels, sizes = label_connected_sets(contact[slabs.rows], periodic, slabs, comm)
            expected, alone = label_connected_sets(contact, periodic)
            assert np.array_equal(np.sort(sizes), np.sort(alone))
            labels = np.vstack(comm.allgather(labels))
            pairs = np.unique(np.stack([labels[contact], expected[contact]]), axis=1)
            assert pairs.shape[1] == len(alone) and np.array_equal(sizes[pairs[0] - 1], alone[pairs[1] - 1])
