"""A program that uses the public interface, as users with a type checker do.

`assert_type` states the types that a type checker finds. tests/unit/test_types.py checks the program, and runs it.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import app.api.creep
import app.api.law
import app.api.load_path
import app.api.refinement
import app.api.slip
import app.api.solution_table
import app.api.wear
import app.contact.certificate
import app.contact.grid_errors
import app.flow.results
import app.halfspace.stress.subsurface
import app.io.contact_fields
import app.io.result
import app.problems.residual_surface
import app.problems.statistics
import app.problems.surfaces.measured_surface
import app.problems.surfaces.resampling
import app.reference.base
from app import (
    Cone,
    ContactProblem,
    ContactSolver,
    Cylinder,
    EllipticHertz,
    FlatPunch,
    Grid,
    InputError,
    Listener,
    Material,
    NoteWarning,
    Paraboloid,
    Plane,
    Roller,
    SelfAffineSurface,
    Solution,
    Sphere,
    __version__,
    fit_grid,
    read_result,
    read_surface,
    refine,
    roughness,
    solve,
    solve_many,
    stress,
    von_mises,
)
from app.problems.problem import Problem
from app.reference import Westergaard

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Counter(Listener):
    """A listener that counts iterations."""

    count = 0

    def iteration(self, entry: dict[str, Any], state: Any) -> None:
        """Count an iteration."""
        self.count += 1


class Bowl(Problem):
    """A problem of the user's own."""

    def shape_on(self, grid: Grid, rows: slice = slice(None)) -> Array:
        """Return the undeformed distance."""
        return np.add.outer(grid.y(rows) ** 2, grid.x() ** 2) / 40


def parabola(x: Array, y: Array) -> Array:
    """Return the undeformed distance of a ball."""
    result: Array = (x**2 + y**2) / 40
    return result


assert_type(__version__, str)

# Grids, materials and shapes
grid = Grid.from_domain(16, 16, (-1, 1, "-1 mm", 1))
assert_type(grid, Grid)
assert_type(grid.refine(), Grid)
assert_type(grid.coarsen(), Grid | None)
assert_type(grid.shape, tuple[int, int])
assert_type(grid.sides, tuple[float, float])
assert_type(grid.cell_area, float)
assert_type(grid.x(), Array)
assert_type(grid.y(slice(0, 4)), Array)
assert_type(Grid(8, 4, 0.5, 0.5, periodic="x").doubly_periodic, bool)
steel = Material.isotropic(210e3, 0.3)
assert_type(steel, Material)
assert_type(Material.combined(80e3, 0.3).compliance, float)
assert_type(Material.pair((210e3, 3e3), (0.3, 0.35)).contact_modulus, float)
assert_type(Material.from_contact_modulus(25).describe(), dict[str, Any])
assert_type(Material(shear_modulus=80e3, poisson_ratio=0.3).conducting(resistivity=1e-7), Material)
coated = Material.coated((450e3, 210e3), (0.25, 0.3), "2 um", other=(210e3, 0.3))
assert_type(coated.is_half_space, bool)
assert_type(Material.layer(5.0, 0.45, thickness=3.0), Material)
rubber = steel.viscoelastic(times=[0.1, 10], moduli=[0.3, 0.4])
ball = Sphere("20 mm")
assert_type(ball.rx, float)
assert_type(ball.distance(0.5, grid.y()), Array)
assert_type(Paraboloid.between((20.0, 30.0), 40.0), Paraboloid)
assert_type(ball.analytic(1e5, load=100), app.reference.base.NormalContact | None)
roller = Roller(10, 1.5, crown=lambda y: y**2 / 100)
assert_type(roller.drop(grid.y()), Array)
for shape in (ball, Cylinder(10), Cone(1), FlatPunch(1.5), Plane(), roller):
    assert_type(ContactProblem(grid, steel, shape).shape_on(grid), Array)

# Problems and solutions
problem = ContactProblem(grid, steel, ball)
assert_type(problem.notes, tuple[str, ...])
assert_type(problem.on(grid.refine()), ContactProblem)
assert_type(problem.reference(0.01), app.reference.base.NormalContact | None)
solution = solve(problem, load=300)
assert_type(solution, Solution)
assert_type(solution.pressure, Array)
assert_type(solution.gap, Array)
assert_type(solution.undeformed_distance, Array)
assert_type(solution.x, Array)
assert_type(solution.contact, Mask)
assert_type(solution.converged, bool)
assert_type(solution.load + solution.contact_area, float)
assert_type(solution.contact_cells, int)
assert_type(solution.error_bound, float)
assert_type(solution.plastic_depth, Array | None)
assert_type(solution.notes, tuple[str, ...])
assert_type(solution.history, dict[str, list[Any]])
assert_type(solution.attributes, dict[str, Any])
assert_type(solution.stiffness, float | None)
assert_type(solution.certificate, app.contact.certificate.Certificate)
assert_type(solution.grid, Grid)
assert_type(solution.gather(), Solution | None)
assert_type(solution.summary(), str)
assert_type(solution.distribution("pressure", bins=10), tuple[Array, Array])
patches = solution.patches()
assert_type(patches, app.io.contact_fields.Patches)
assert_type(patches.area, Array)
assert_type(solution.flow(), app.flow.results.Flow)
assert_type(solution.flow().x.transmissivity, float)
assert_type(solution.flow().y.flux_x, Array)
hard = solve(ContactProblem(grid, steel, parabola, hardness=500), approach="10 um")
assert_type(hard.residual_surface(), app.problems.residual_surface.ResidualSurface)
assert_type(solve(Bowl(grid, steel), load=300, start=solution).load, float)

# Solvers
counter = Counter()
with ContactSolver(problem, "fmg_v11", {"lcp_rtol": 1e-6}, listeners=[counter]) as solver:
    assert_type(solver, ContactSolver)
    assert_type(solver.touching, float)
    solver.check(load=100)
    path = solver.path(load=[100, 200], stiffness=True)
    assert_type(path, app.api.load_path.LoadPath)
    for step in path:
        assert_type(step, Solution)
    assert_type(len(path), int)
    assert_type(path.table["load"].mean() > 0, Any)
    assert_type(path.rows, list[dict[str, Any]])
    solver.update(ContactProblem(grid, steel, parabola))
    solution = solver.solve(load=300, start=solution)
    assert_type(solution, Solution)
    assert_type(solver.stiffness(solution), float)
    assert_type(solver.with_stiffness(solution), Solution)
    assert_type(solver.sensitivity(solution, of="approach"), Array)
    slip = solver.slip(load=300, friction=0.3, tangential_load=50)
    assert_type(slip, app.api.slip.PartialSlip)
    assert_type(slip.traction, Array)
    assert_type(slip.numbers, dict[str, float])
    slips = solver.slip(load=300, friction=0.3, tangential_load=[20, 50])
    assert_type(slips, list[app.api.slip.PartialSlip])
    law = solver.law(load=(100, 400), tolerance=0.1)
    assert_type(law, app.api.law.ContactLaw)
    assert_type(law.at(load=[150, 200]), dict[str, np.ndarray[Any, Any]])
    worn = solver.wear(1e-9, 100, 2, load=300)
    assert_type(worn, app.api.wear.WearPath)
    assert_type(list(worn), list[Solution])
    with solver.replaced(problem) as same:
        assert_type(same, ContactSolver)
assert_type(counter.count, int)
with ContactSolver(ContactProblem(grid, rubber, ball)) as solver:
    creep = solver.creep(times=np.array([0.0, 1.0]), load=300)
    assert_type(creep, app.api.creep.CreepPath)
    assert_type(list(creep), list[Solution])
    assert_type(creep.times, list[float])

# Other functions
refined = refine(ContactProblem(grid, steel, ball), until=0.5, load=300, quantities=["max_pressure"])
assert_type(refined, app.api.refinement.Refinement)
assert_type(refined.solution, Solution)
assert_type(refined.errors, app.contact.grid_errors.GridErrors)
assert_type(refined.errors.largest, float)
assert_type(fit_grid(lambda x, y: x**2 + y**4, steel, load=300), Grid)
assert_type(fit_grid(ball, steel, cells=16, load=300), Grid)
table = solve_many([problem], [[100, 200]])
assert_type(table, app.api.solution_table.SolutionTable)
assert_type(table.units, dict[str, str])
assert_type(table.converged, bool)
below = stress(solution)
assert_type(below, app.halfspace.stress.subsurface.SubsurfaceStress)
assert_type(below.plane(0.1), Array)
assert_type(von_mises(below.line([0.0, 0.1], x=0, y=0)), Array)
assert_type(below.maximum().depth, float)
assert_type(below.maxima(), list[app.halfspace.stress.subsurface.StressMaximum])
with TemporaryDirectory() as folder:
    file = Path(folder, "solution.h5")
    solution.save(file, operator="me")
    path.save(str(Path(folder, "path.csv")))
    table.save(Path(folder, "table.csv"))
    result = read_result(file)
assert_type(result, app.io.result.Result)
assert_type(result.pressure, Array)
assert_type(result.contact, Mask)
assert_type(result.grid, Grid)
assert_type(result.path, dict[str, np.ndarray[Any, Any]])

# Surfaces
rough = SelfAffineSurface(0.8, 1.0, 0.3, (4, 4), seed=1, rms_height="1 um")
assert_type(rough.rms_slope, float)
assert_type(rough.heights_on(grid), Array)
measured = read_surface(rough.heights_on(grid), unit="mm", spacing=0.125, level="plane")
assert_type(measured, app.problems.surfaces.measured_surface.Surface)
assert_type(measured.shape, tuple[int, int])
assert_type(measured.grid(), Grid)
assert_type(measured.resampled(), app.problems.surfaces.resampling.ResampledSurface)
assert_type(roughness(measured), app.problems.statistics.Roughness)
assert_type(roughness(rough.heights_on(grid), 0.125, 0.125).rms_height, float)
assert_type(ContactProblem(measured.grid(), steel, ball, surfaces=[rough, measured]), ContactProblem)

# Analytic solutions
hertz = EllipticHertz.from_load(20.0, 20.0, steel.contact_modulus, load=300)
assert_type(hertz, EllipticHertz)
assert_type(hertz.max_pressure, float)
assert_type(hertz.pressure(grid.x(), 0), Array)
assert_type(Westergaard(1e-3, 1.0, 1e5, 10.0).contact_fraction, float)

# Errors
try:
    solve(problem, load=-1)
except InputError as error:
    assert_type(str(error), str)
assert_type(issubclass(NoteWarning, UserWarning), bool)
