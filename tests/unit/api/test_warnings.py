"""Notes as Python warnings, and progress bars."""

import warnings

import numpy as np
import pytest

from app import (
    ContactProblem,
    ContactSolver,
    Grid,
    Material,
    NoteWarning,
    Sphere,
    read_surface,
    refine,
    solve,
)


def notes_issued(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    assert all(warning.category is NoteWarning and warning.filename == __file__ for warning in caught)
    return [str(warning.message) for warning in caught]


SOFT_BALL = ContactProblem(Grid.from_domain(16, 16, (-1, 1, -1, 1)), Material.isotropic(210, 0.3), Sphere(20))


def test_notes_are_warnings_of_the_caller_s_line():
    kept = []
    issued = notes_issued(lambda: kept.append(solve(SOFT_BALL, load=0.1)))
    assert issued == list(kept[0].notes)
    assert any("for GPa write 210e3" in note for note in issued)


def test_a_load_path_warns_of_each_kind_of_notes_once():
    with ContactSolver(SOFT_BALL) as solver:
        issued = notes_issued(lambda: list(solver.path(load=[0.1, 0.2, 0.3])))
    assert sum("as soft as a plastic" in note for note in issued) == 1


def test_a_refinement_warns_of_its_finest_grid():
    kept = []
    issued = notes_issued(lambda: kept.append(refine(SOFT_BALL, until=0.1, load=0.1)))
    assert len(kept[0].rows) > 1
    assert issued == list(kept[0].solution.notes)


def test_reading_a_surface_warns_of_slopes_and_the_solve_not_again():
    """Heights in um that were meant in nm."""
    grid, kept = SOFT_BALL.grid, []
    heights = np.random.default_rng(1).normal(size=grid.shape)
    spacing = (1e3 * grid.dx, 1e3 * grid.dy)
    read = lambda: kept.append(read_surface(heights, "mm", spacing=spacing, spacing_unit="um"))  # noqa: E731
    assert any("steeper than the theory allows" in note for note in notes_issued(read))
    assert kept[0].spacing == pytest.approx((grid.dx, grid.dy))
    problem = ContactProblem(grid, SOFT_BALL.material, surfaces=kept)
    issued = notes_issued(lambda: kept.append(solve(problem, load=1)))
    assert any("steeper" in note for note in kept[1].notes)
    assert not any("steeper" in note for note in issued)


def test_progress_is_shown_on_request(capsys):
    with warnings.catch_warnings(), ContactSolver(SOFT_BALL) as solver:
        warnings.simplefilter("ignore")
        list(solver.path(load=[0.1, 0.2]))
        assert not capsys.readouterr().err
        list(solver.path(load=[0.1, 0.2], progress=True))
        assert "2/2" in capsys.readouterr().err
        refine(SOFT_BALL, until=0.5, load=0.1, progress=True)
        assert "refine: 3grid" in capsys.readouterr().err
