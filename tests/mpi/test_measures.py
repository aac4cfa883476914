"""Faces and differences between the rows of two ranks, and around a periodic patch."""

from itertools import product

import numpy as np
import pytest
from mpi4py import MPI
from operators import slabs_of
from running import solve

from app import ContactProblem, Grid, Material, SelfAffineSurface, read_surface
from app.contact.distance import UndeformedDistance
from app.contact.measures import ContactMeasures, contact_width
from app.contact.periodic_state import contact_state
from app.halfspace.kernel import UNIT
from app.halfspace.operator import InfluenceOperator
from app.parallel.communicator import Communicator

STEEL = Material.from_contact_modulus(1e5)
MEASURES = (
    "perimeter", "contact_fraction", "contact_fraction_corrected", "mean_gap", "mean_pressure", "rms_slope",
    "rms_height",
)  # fmt: skip


def problems():
    """Yield free and periodic problems with and without holes; some ranks have one row or none."""
    for shape in ((2, 24), (13, 16)):
        grid = Grid.from_domain(*shape[::-1], (0.0, 3.0, 0.0, 2.0))
        gap = 1e-3 * np.random.default_rng(3).normal(size=shape)
        for periodic in (False, "love"):
            yield ContactProblem(grid, STEEL, gap, periodic)
            yield ContactProblem(grid, STEEL, np.where(gap > 2e-3, np.nan, gap), periodic)
    grid = Grid.from_domain(16, 12, (0.0, 3.0, 0.0, 2.0), "spectral")
    yield ContactProblem(
        grid, STEEL, surfaces=[SelfAffineSurface(0.8, 2.0, 0.5, (3.0, 2.0), 1, rms_slope=0.01)]
    )


@pytest.mark.mpi(2, 3)
def test_measures_are_independent_of_ranks(comm):
    for problem in problems():
        several, alone = (solve(problem, -5e-4, comm=one, lcp_rtol=1e-12) for one in (comm, MPI.COMM_SELF))
        assert 0 < alone.contact_fraction < 1
        for name in MEASURES:
            assert getattr(several, name) == pytest.approx(getattr(alone, name), rel=1e-9), name


@pytest.mark.mpi(1, 2, 3)
def test_narrow_contact_is_noted_on_any_rank(comm):
    """Across the rows of several ranks, and across the sides of a periodic patch."""
    for width, periodic, along in product((1, 3, 4, 9, 10), (False, True), "xy"):
        rows = np.arange(4, 4 + width) - 5 * periodic
        gap = np.ones((19, 22) if along == "x" else (22, 19))
        (gap if along == "x" else gap.T)[rows] = 0.0
        problem = ContactProblem(Grid(*gap.shape[::-1], 1.0, 1.0), STEEL, gap, periodic)
        notes = [
            note for note in solve(problem, 1e-3, comm=comm).notes if note.startswith("contact is at most")
        ]
        across = "yx"[along == "y"]
        assert [note.split(" wide in ")[1][0] for note in notes] == [across] * (width < 10), notes
        assert all(note.split()[4] == str(width) for note in notes)


@pytest.mark.mpi(2, 3)
def test_patches_are_independent_of_ranks(comm):
    several = 0
    for problem in problems():
        solution = solve(problem, -5e-4, comm=comm, lcp_rtol=1e-12)
        found, whole = solution.patches(), comm.bcast(solution.gather())
        expected = whole.patches()
        assert np.array_equal(found.labels, expected.labels[solution.slabs.rows])
        assert np.array_equal(found.cells, expected.cells)
        for name in ("area", "load", "max_pressure", "centre_x", "centre_y"):
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), 1e-9, 1e-9, err_msg=name
            )
        several += len(found.cells) > 1
    assert several > 3


@pytest.mark.mpi(1, 3)
def test_load_on_filled_points_is_of_all_ranks(comm):
    """The filled rows 9 to 12 are on two ranks."""
    x = np.linspace(-1, 1, 32)
    cap = -(x**2) - (x[:, None] + 0.3) ** 2
    cap[9:13] = np.nan
    surface = read_surface(cap, "um", missing="fill", spacing=(1e-3, 1e-3))
    problem = ContactProblem(surface.grid(), STEEL, surfaces=[surface])
    solution = solve(problem, None, None, load=0.02, comm=comm)
    share = solution.gather()
    share = comm.bcast(share and share.pressure[9:13].sum() / share.pressure.sum())
    assert any(
        f"{100 * share:.2g}% of the load is carried by filled points" in note for note in solution.notes
    )


@pytest.mark.mpi(1, 2, 3)
@pytest.mark.parametrize("periodic", [False, "x", "y", True])
def test_contact_width_is_the_longest_run(comm, periodic):
    rng, fractions = np.random.default_rng(3), ContactMeasures(*[0.0] * 9, -1.0, *[0.0] * 4)
    comm = Communicator(comm)
    for shape in ((7, 12), (3, 5), (23, 9), (1, 4)):
        grid = Grid(*shape[::-1], 1.0, 1.0, periodic=periodic)
        several = comm if comm.size > 1 else None
        operator = InfluenceOperator(grid, UNIT, slabs_of(comm, grid), several)
        for share in (0.0, 0.3, 0.7, 0.9, 1.0):
            contact = rng.random(shape) < share
            state = contact_state(operator, UndeformedDistance(operator, np.ones(operator.local_shape)))
            state.contact[...] = contact[operator.slabs.rows]
            expected = []
            for axis, repeats in ((1, grid.repeats[1]), (0, grid.repeats[0])):
                run, width = contact, 0
                while width < shape[axis] and run.any():
                    other = np.roll(run, 1, axis)
                    np.moveaxis(other, axis, 0)[0] &= repeats
                    run, width = run & other, width + 1
                expected.append(min(width, 10, shape[axis]))
            assert contact_width(state, fractions, 10) == tuple(expected)
            state.destroy()
