"""-problem python: user-defined problems, as functions and classes."""

import numpy as np
import pytest
from mpi4py import MPI

from app import Grid, InputError, Material
from app.cli.option_sources import ParsedOptions
from app.cli.problem_options import Request
from app.problems.problem import evaluate_shape
from app.problems.user_problem import create, validate

MODULE = """
import numpy as np
from app.options.option_table import Option, REQUIRED, positive
from app.problems.problem import Problem

def bowl(x, y):
    return x**2 + y**2

def scalar(x, y):
    return max(x, 0)

def short(x, y):
    return np.zeros(3)

def huge(x, y):
    return np.where(x > 0.5, np.inf, x)

def gives_up(x, y):
    raise SystemExit("not today")

number = 3

class Plane(Problem):
    def shape_on(self, grid, rows=slice(None)):
        return np.zeros((len(grid.y(rows)), grid.nx))

class Cone(Problem):
    OPTIONS = (Option("cone_slope", positive, REQUIRED, "height over radius"),)
    name = "cone"

    def __init__(self, grid, material, slope):
        super().__init__(grid, material)
        object.__setattr__(self, "slope", slope)

    @classmethod
    def from_options(cls, grid, material, options):
        return cls(grid, material, options["cone_slope"])

    def shape_on(self, grid, rows=slice(None)):
        return self.slope * np.hypot(grid.x()[None, :], grid.y(rows)[:, None])

class Forgets(Cone):
    @classmethod
    def from_options(cls, grid, material, options):
        pass

class Masked(Plane):
    def shape_on(self, grid, rows=slice(None)):
        return np.ma.masked_greater(np.broadcast_to(grid.x(), (len(grid.y(rows)), grid.nx)), 0)

class Transposed(Plane):
    def shape_on(self, grid, rows=slice(None)):
        return super().shape_on(grid, rows).T
"""


@pytest.fixture
def make(tmp_path, monkeypatch):
    """``make("my_module.bowl")``: a valid problem, and the reader of its options, in a folder with my_module.py."""
    (tmp_path / "my_module.py").write_text(MODULE)
    (tmp_path / "broken.py").write_text("import numpy\nnumpy.no_such_thing\n")
    (tmp_path / "typo.py").write_text("def f(x, y:\n")
    monkeypatch.chdir(tmp_path)

    def make_named(name, **texts):
        problem, own = create(
            name, Grid.from_domain(6, 4, (-2, 1, -1, 1)), Material.combined(1.0, 0.3), texts
        )
        validate(problem, name, slice(None))
        return problem, own

    return make_named


@pytest.mark.parametrize("name", ["my_module.bowl", "my_module.py:bowl"])
def test_function_is_called_with_the_cell_centres_of_any_grid(make, name):
    problem, own = make(name)
    for grid in (problem.grid, problem.grid.coarsen(2)):
        expected = grid.x()[None, :] ** 2 + grid.y()[:, None] ** 2
        assert np.array_equal(problem.shape_on(grid), expected)
        assert np.array_equal(problem.shape_on(grid, slice(1, 2)), expected[1:2])
    assert problem.describe()["problem"] == name
    assert not own.asked


def test_contact_is_impossible_in_masked_cells(make):
    problem, _ = make("my_module.Masked")
    np.testing.assert_array_equal(
        np.isnan(evaluate_shape(problem, problem.grid, slice(4))), np.tile(problem.grid.x() > 0, (4, 1))
    )


def test_class_reads_options_of_its_own(make):
    problem, own = make("my_module.Cone", cone_slope="0.5")
    assert problem.shape_on(problem.grid)[0, 0] == 0.5 * np.hypot(-1.75, -0.75)
    assert own.asked == {"cone_slope"}
    assert problem.describe()["problem"] == "cone"
    assert make("my_module.Plane")[0].describe()["problem"] == "my_module.Plane"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bowl", "must be module.Name or file.py:Name"),
        ("nowhere.bowl", "No module named 'nowhere'"),
        ("nowhere.py:bowl", "no such file"),
        ("my_module.bowls", "my_module has no bowls"),
        ("my_module.number", "must be a function of x and y, or a class derived from app.problems.problem.Problem"),
        ("my_module.Forgets", "from_options returns no"),
        ("my_module.Cone", "-cone_slope is missing: height over radius"),
        ("my_module.Transposed", r"shape \(6, 4\); must be .* = \(4, 6\)"),
        ("my_module.scalar", r"ValueError: The truth value .*np.vectorize.* \(.*my_module.py, line 10\)"),
        ("my_module.short", r"gap: .*\(3,\); must be \(4, 6\)"),
        ("my_module.huge", "must be numbers up to"),
        ("broken.f", r"AttributeError: .*no_such_thing.* \(.*broken.py, line 2\)"),
        ("my_module.gives_up", r": SystemExit: not today \(.*my_module.py, line \d+\)"),
        ("typo.f", r"SyntaxError: .*line 1"),
    ],
)  # fmt: skip
def test_errors_of_user_problems_are_one_line(make, name, message):
    with pytest.raises(InputError, match=message) as refusal:
        make(name)
    assert str(refusal.value).startswith(f"-problem_type {name}: ")
    assert "\n" not in str(refusal.value)


def test_a_misspelt_option_of_a_user_problem_is_refused(make):
    texts = {"problem": "python", "problem_type": "my_module.Cone", "cone_slope": "1", "cone_slpoe": "2"}
    texts |= {"grid": "6,4", "domain": "-2,1,-1,1", "contact_modulus": "1", "load": "1"}
    with pytest.raises(InputError, match=r"unknown option: -cone_slpoe \(did you mean -cone_slope\?\)"):
        Request(ParsedOptions(texts), MPI.COMM_SELF)
