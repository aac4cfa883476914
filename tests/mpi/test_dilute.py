"""Dilute contact on lists of cells, on one and several ranks."""

from unittest import mock

import numpy as np
import pytest
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid, Material
from app.halfspace import periodic_list_product
from app.methods.free import dilute


def spheres(body=None, periodic=False):
    """Return balls, and a spike that vanishes in coarse cells."""
    size = (96, 128) if periodic else (48, 70)
    grid = Grid.from_domain(*size, (0.0, 1.2, 0.0, 1.75), periodic)
    x, y = np.meshgrid(grid.x(), grid.y())
    gap = np.min([(x - i) ** 2 + (y - j) ** 2 + h for i, j, h in ((0.3, 0.4, 0), (0.9, 1.5, 0.01))], axis=0)
    gap[35, 40] = 0.015
    layered = Material.coated((0.2, 1.0), (0.49, 0.3), 0.1)
    gap[:, 11] = np.nan if body == "holes" else gap[:, 11]
    hardness = 0.1 * (1 + np.abs(np.sin(x))) if body == "hardness" else None
    material = layered if body == "layer" else Material.from_contact_modulus(1.0)
    return ContactProblem(grid, material, gap, hardness=hardness)


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize(
    ("body", "periodic"),
    [(None, False), ("layer", False), ("hardness", False), ("holes", False), (None, True), ("hardness", "x")],
)
def test_lists_find_the_same_on_any_number_of_ranks(comm, body, periodic):
    def solve(comm, start=None, **loading):
        with ContactSolver(spheres(body, periodic), options={"lcp_rtol": 1e-9}, comm=comm) as solver:
            first = solver.solve(load=start) if start else None
            found = solver.solve(start=first, **loading)
            assert not found.contact_cells or "exact_product" not in vars(solver.hierarchy.target)
            if comm.rank == comm.size - 1:
                assert found.displacement.shape == found.pressure.shape  # no other rank takes part
            return found.gather()

    limits = dict.fromkeys(
        ("MAX_COST", "MAX_COST_PERIODIC", "MAX_GROWN_COST", "MAX_CHECK_COST", "MAX_SHARE"), np.inf
    )
    small = mock.patch.multiple(periodic_list_product, _MIN_CELLS=64, _MIN_NODES=12, _MARGIN=8)
    tilted = [] if periodic else [{"load": 0.003, "tilt": (0.01, 0.003)}]
    with small, mock.patch.multiple(dilute, MIN_CELLS=64, **limits):
        for loading in (
            {"load": 0.003},
            {"approach": 0.03},
            {"approach": 1e-7},
            *tilted,
            {"load": 0.003, "start": 0.002},
            {"approach": 0.03, "start": 0.002},
        ):
            shared, alone = solve(comm, **loading), solve(MPI.COMM_SELF, **loading)
            if comm.rank == 0:
                assert shared.converged and not shared.fallbacks
                assert (shared.contact == alone.contact).all()
                names = "pressure", "displacement", "mean_gap", "plastic_volume", "contact_area_error"
                for name in names:
                    values = getattr(alone, name)
                    np.testing.assert_allclose(
                        getattr(shared, name), values, atol=1e-9 * np.abs(values).max()
                    )
