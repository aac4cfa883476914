"""Patches of contact: sets of cells that hang together by faces, not by corners alone. Not collective."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def label_patches(contact, periodic=False):
    """Number the patches of contact.

    Parameters
    ----------
    contact : array_like of bool, shape (ny, nx)
        All of it.
    periodic : bool
        What leaves on one side comes in on the other.

    Returns
    -------
    labels : ndarray of int, shape (ny, nx)
        0 where there is no contact, else from 1 on.
    cells : ndarray of int, shape (patches,)
        Of each.
    """
    labels, count = ndimage.label(contact)
    if periodic and count:
        pairs = [np.stack([labels[0], labels[-1]]), np.stack([labels[:, 0], labels[:, -1]])]
        pairs = np.hstack(pairs)
        pairs = pairs[:, (pairs > 0).all(axis=0)] - 1
        same = coo_array((np.ones(pairs.shape[1], bool), tuple(pairs)), shape=(count, count))
        _, of = connected_components(same, directed=False)
        labels = np.concatenate([[0], of + 1])[labels]
    return labels, np.bincount(labels.ravel())[1:]
