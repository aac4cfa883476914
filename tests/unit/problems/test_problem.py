"""The interface of contact problems."""

from dataclasses import dataclass

import numpy as np
import pytest

from app import ContactProblem, Grid, InputError, Material, Sphere
from app.problems import problem as module
from app.problems.problem import Problem, evaluate_shape

GRID, STEEL = Grid(4, 3, 1.0, 1.0), Material.from_contact_modulus(1e5)


@dataclass(frozen=True)
class Constant(Problem):
    """A shape that is given as such."""

    value: object = 0.0
    name = "constant"

    def shape_on(self, grid, rows=slice(None)):
        return self.value


def test_a_problem_on_another_grid_has_the_same_parts():
    problem = Constant(GRID, STEEL, 2.0)
    finer = problem.on(Grid(8, 6, 0.5, 0.5))
    assert (finer.grid.shape, finer.material, finer.value) == ((6, 8), STEEL, 2.0)
    assert problem.grid is GRID
    assert problem.fits(Constant(GRID, STEEL, 3.0)) and not problem.fits(finer)


def test_a_shape_is_a_valid_copy():
    values = np.ones((2, 4), np.float32)
    shape = evaluate_shape(Constant(GRID, STEEL, values), GRID, slice(0, 2))
    assert shape.dtype == float and shape.flags.c_contiguous
    np.testing.assert_array_equal(shape, values)
    assert evaluate_shape(Constant(GRID, STEEL, None), GRID, slice(3, 3)).shape == (0, 4)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.ones((3, 4)), r"undeformed distances of shape \(3, 4\); must be \(rows, nx\) = \(2, 4\)"),
        (1.0, r"undeformed distances of shape \(\); must be"),
        ("flat", "must be undeformed distances, an array of real numbers"),
        (np.full((2, 4), -np.inf), "-inf in row 1, column 0; must be numbers up to"),
    ],
)
def test_other_shapes_are_refused(value, message):
    with pytest.raises(InputError, match=f"^problem constant: {message}"):
        evaluate_shape(Constant(GRID, STEEL, value), GRID, slice(1, 3))


def test_blocks_of_rows_have_the_same_shape(monkeypatch):
    grid = Grid(9, 23, 0.1, 0.2)
    heights = np.random.default_rng(0).random(grid.shape)
    problem = ContactProblem(grid, STEEL, Sphere(10.0), surfaces=[heights])
    for rows in (slice(None), slice(3, 20), slice(5, 5)):
        monkeypatch.setattr(module, "_BLOCK", 10**6)
        whole = evaluate_shape(problem, grid, rows)
        monkeypatch.setattr(module, "_BLOCK", 40)
        np.testing.assert_array_equal(evaluate_shape(problem, grid, rows), whole)
