"""Programs that use the Python API and do not clean up after themselves."""

import subprocess
import sys

import pytest
from processes import TESTS, run

PROBLEM = """
import numpy as np
from app import ContactProblem, ContactSolver, Grid, Material, solve
grid = Grid.from_domain(48, 48, (-1, 1, -1, 1))
def ball(x, y):
    return (x**2 + y**2) / 40
problem = ContactProblem(grid, Material.combined(80000, 0.3), ball)
"""
PROGRAMS = {
    "forgotten": "solver = ContactSolver(problem)\nfound = solver.solve(approach=0.005)",
    "forgotten in a circle": (
        "solver = ContactSolver(problem)\nsolver.me = solver\nsolver.solve(approach=0.005)\ndel solver"
    ),
    "several, in a list": (
        "solvers = [ContactSolver(problem, method) for method in ('fmg_v11', None, 'norm', 'mg_v11')]\n"
        "found = [solver.solve(approach=0.005) for solver in solvers]\ndel solvers[1]"
    ),
    "reference solver": "solver = ContactSolver(problem, options={'lcp_type': 'snesvi'})\nsolver.solve(approach=0.005)",
    "in the middle": "solver = ContactSolver(problem)\nimport sys\nsys.exit()",
    "PETSc first": (
        "solver = ContactSolver(problem)\nsolver.solve(approach=0.005)\n"
        "from petsc4py import PETSc\nleft = PETSc.Options().getAll()\n"
        "assert left == {'ksp_rtol': '0.5', 'options_left': 'no'}, left"
    ),
}


@pytest.mark.parametrize(
    ("name", "ranks"),
    [*((name, 1) for name in PROGRAMS), ("forgotten", 2), ("several, in a list", 2), ("in the middle", 2)],
)
def test_a_solver_that_is_not_closed_ends_without_a_crash(name, ranks, tmp_path):
    program = tmp_path / "program.py"
    start = (
        "import petsc4py, sys\npetsc4py.init('program -ksp_rtol 0.5 -options_left no'.split())\n"
        if name == "PETSc first"
        else ""
    )
    program.write_text(start + PROBLEM + PROGRAMS[name] + "\n")
    done = run(program, ranks=ranks)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.ranks(1, 2)
def test_an_exception_that_nobody_catches(ranks, tmp_path):
    """The traceback, and an end; not a crash on top of it."""
    program = tmp_path / "program.py"
    program.write_text(PROBLEM + "solver = ContactSolver(problem)\nsolver.solve(approach=0.1, load=1.0)\n")
    done = run(program, ranks=ranks)
    assert done.returncode == 1
    assert "app.base.errors.InputError: exactly one of approach [mm], load [N], mean_pressure" in done.stderr
    assert "Segmentation" not in done.stderr


def test_an_interrupt_inside_petsc(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        PROBLEM
        + """
from app.methods.free.circulant import Circulant
def precondition(self, r, z, reduced):
    raise KeyboardInterrupt
Circulant.precondition = precondition
solve(problem, approach=0.005)
"""
    )
    done = run(program)
    assert done.stderr.splitlines()[-1] == "KeyboardInterrupt"


def test_a_pipe_that_nobody_reads_any_more(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROBLEM + "while True:\n    print('line', flush=True)\n")
    started = subprocess.Popen(
        [sys.executable, program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=TESTS.parent
    )
    assert started.stdout.readline() == b"line\n"
    started.stdout.close()
    assert b"BrokenPipeError" in started.stderr.read().splitlines()[-1]
    assert started.wait() in (1, 120)  # Python 3.13 says that it could not write the rest
