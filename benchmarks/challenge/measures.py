"""Numbers and distributions of one solution."""

import math

import numpy as np

from app.halfspace.connected_sets import label_connected_sets

PRESSURES = np.linspace(0, 4, 81)  # over E* times the rms slope
GAPS = np.logspace(-5, 1, 61)  # over the rms height
AREAS = np.logspace(-8, 0, 41)  # of patches, over that of the period


def persson_pressures(pressure, load):
    """Persson's distribution of the pressure; both over E* h'rms."""
    p, width = np.asarray(pressure), 0.5
    bell = np.exp(-((p - load) ** 2) / (2 * width**2)) - np.exp(-((p + load) ** 2) / (2 * width**2))
    return bell / (width * math.sqrt(2 * math.pi))


def patch_cells(contact):
    """Return the cells of every contact spot, the largest first.

    Spots are connected by sides of cells, also across the period.
    """
    _, cells = label_connected_sets(contact, periodic=True)
    return np.sort(cells)[::-1]


def corrected_fraction(contact):
    """Return the contact fraction corrected for the stepped contact edge."""
    faces = sum(np.count_nonzero(contact != np.roll(contact, 1, axis)) for axis in (0, 1))
    return contact.mean() - (math.pi - 1 + math.log(2)) / 24 * faces / contact.size


def numbers(pressure, gap, unit, rms_height):
    """Numbers of a solution.

    Parameters
    ----------
    pressure, gap : ndarray, shape (n, n), [N/mm2], [mm]
    unit : float
        E* h'rms [N/mm2].
    rms_height : float
        [mm]

    Returns
    -------
    dict of str to float
    """
    contact = pressure > 0
    patches = patch_cells(contact)
    found = {
        "contact_fraction": contact.mean(),
        "corrected_fraction": corrected_fraction(contact),
        "mean_gap": gap.mean() / rms_height,
        "max_pressure": pressure.max() / unit,
        "patches": len(patches),
        "largest_patch": patches[0] / contact.size if len(patches) else 0.0,
    }
    return {name: float(value) for name, value in found.items()}


def densities(pressure, gap, unit, rms_height):
    """Distributions of a solution; parameters as of `numbers`.

    Returns
    -------
    dict of str to ndarray
        Densities in `PRESSURES` (over all cells), in `GAPS` (over the cells without contact), and patches per decade of
        `AREAS`.
    """
    contact = pressure > 0
    open_gaps = gap[~contact] / rms_height

    def density(values, edges, total):
        return np.histogram(values, edges)[0] / np.diff(edges) / max(total, 1)

    per_decade = 1 / math.log10(AREAS[1] / AREAS[0])
    return {
        "pressure": density(pressure[contact] / unit, PRESSURES, contact.size),
        "gap": density(open_gaps, GAPS, open_gaps.size),
        "patch": np.histogram(patch_cells(contact) / contact.size, AREAS)[0] * per_decade,
    }


def middles(kind):
    """Return the middles of the bins of a density."""
    if kind == "pressure":
        return (PRESSURES[1:] + PRESSURES[:-1]) / 2
    edges = GAPS if kind == "gap" else AREAS
    return np.sqrt(edges[1:] * edges[:-1])


def stiffness(rows):
    """Return -d(load) / d(mean gap) between neighbouring loads, at their geometric means.

    A pressure that falls exponentially with the gap, as it does under light loads, gives it exactly.

    Parameters
    ----------
    rows : sequence of mapping
        With `load` (over E* h'rms) and `mean_gap` (over h_rms), in the order of the loads.

    Returns
    -------
    ndarray, ndarray
        Loads and stiffnesses; where the gap does not change (full contact) there is none.
    """
    load, gap = (np.array([row[name] for row in rows], float) for name in ("load", "mean_gap"))
    change, middle = gap[:-1] - gap[1:], np.sqrt(load[1:] * load[:-1])
    there = change > 1e-9
    return middle[there], middle[there] * np.log(load[1:] / load[:-1])[there] / change[there]
