"""Wrong calls of a beginner: the TypeError shows the right one."""

import pytest

from app import ContactProblem, ContactSolver, Grid, Material, Paraboloid, Sphere, read_surface, refine, solve
from app.base.usage import usage

GRID = Grid.from_domain(8, 8, (-1, 1, -1, 1))
STEEL = Material.isotropic(210e3, 0.3)
BALL = ContactProblem(GRID, STEEL, Sphere(10))


@pytest.mark.parametrize(
    ("call", "right"),
    {
        "a load without its name": (lambda: solve(BALL, 700), r"write solve\(problem, load=700\)"),
        "a force": (lambda: solve(BALL, force=700), "'force'; exactly one of .*load"),
        "a solver": (lambda: ContactSolver(BALL).solve(700), r"write solver\.solve\(load=700\)"),
        "a grid of cells alone": (lambda: Grid(64, 64), r"write Grid\.from_domain\(128, 128, "),
        "a grid without a domain": (lambda: Grid.from_domain(64, 64), r"write Grid\.from_domain"),
        "a problem without a material": (lambda: ContactProblem(GRID), r"write ContactProblem\(grid, material, "),
        "a shape by name": (lambda: ContactProblem(GRID, STEEL, shape=Sphere(9)), "write ContactProblem"),
        "one radius of two": (lambda: Paraboloid(10), r"of a ball Sphere\(10\)"),
        "another name of a radius": (lambda: Sphere(r=10), r"write Sphere\(10\)"),
        "numbers of a pair one by one": (
            lambda: Material.pair(210e3, 3e3, 0.3, 0.4),
            r"write Material\.pair\(\(E1, E2",
        ),
        "a limit left out": (lambda: refine(BALL, load=700), r"write refine\(problem, until=0\.01, load=700\)"),
        "units": (lambda: read_surface("z.npy", units="um"), r'write read_surface\("heights.npy", unit="um"'),
    }.values(),
)  # fmt: skip
def test_a_wrong_call_shows_the_right_one(call, right):
    with pytest.raises(TypeError, match=right):
        call()


def test_errors_inside_a_call_stay_as_they_are():
    @usage("double(2)")
    def double(x):
        return x + "2"

    with pytest.raises(TypeError) as raised:
        double(2)
    assert "write" not in str(raised.value)
