"""Compiled loops of the contact state."""

import numpy as np
import pytest

from app.contact import kernels

SHAPE, DEPTH = (5, 7), 0.3


@pytest.fixture
def fields():
    """-h at depth 0, displacement and two sets of cells."""
    rng = np.random.default_rng(1)
    return *rng.normal(size=(2, *SHAPE)), *(rng.random((2, *SHAPE)) < 0.5)


def test_rounding_of_a_sum_is_known():
    x = np.array([[1.0, 1e-17, 1e-17], [5.0, -1.0, 1e-17]])
    mask = np.array([[True, True, True], [False, True, True]])
    total, lost = kernels.compensated_sum(x, mask)
    assert total + lost == pytest.approx(3e-17, rel=1e-9)


@pytest.mark.parametrize("periodic", [False, True])
def test_faces_are_counted_on_slabs_as_on_the_patch(fields, periodic):
    """The ends of rows are faces of a free patch; upper faces of the last row are left out."""
    contact = fields[2]
    edge = contact[-1] if periodic else np.zeros(SHAPE[1], bool)
    whole = kernels.count_faces(contact, edge, periodic)
    parts = (
        kernels.count_faces(contact[:2], edge, periodic),
        kernels.count_faces(contact[2:], contact[1], periodic),
    )
    assert whole == tuple(map(sum, zip(*parts, strict=True)))
    padded = np.pad(contact, ((0, 0), (1, 1)), mode="wrap" if periodic else "constant")
    in_x = np.sum(padded[:, 1:] != padded[:, :-1]) - (np.sum(padded[:, 0] != padded[:, 1]) if periodic else 0)
    assert whole == (in_x, np.sum(contact != np.vstack([edge, contact[:-1]])))
