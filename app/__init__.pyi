# Types of the names that app/__init__.py imports when they are used.
from app.api.fitted_grid import fit_grid as fit_grid
from app.api.many import solve_many as solve_many
from app.api.refinement import refine as refine
from app.api.solution import Solution as Solution
from app.api.solver import ContactSolver as ContactSolver
from app.api.solver import solve as solve
from app.api.subsurface import stress as stress
from app.base.errors import InputError as InputError
from app.base.errors import NoteWarning as NoteWarning
from app.contact.history import Listener as Listener
from app.halfspace.grid import Grid as Grid
from app.halfspace.material import Material as Material
from app.halfspace.stress.subsurface import von_mises as von_mises
from app.io.result import read_result as read_result
from app.problems.contact_problem import ContactProblem as ContactProblem
from app.problems.random_surfaces import SelfAffineSurface as SelfAffineSurface
from app.problems.roller import Roller as Roller
from app.problems.shapes import Cone as Cone
from app.problems.shapes import Cylinder as Cylinder
from app.problems.shapes import FlatPunch as FlatPunch
from app.problems.shapes import Paraboloid as Paraboloid
from app.problems.shapes import Plane as Plane
from app.problems.shapes import Sphere as Sphere
from app.problems.statistics import roughness as roughness
from app.problems.surfaces.reading import read_surface as read_surface
from app.reference.hertz import EllipticHertz as EllipticHertz

__version__: str
