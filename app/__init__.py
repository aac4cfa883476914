"""Elastic contact by full multigrid.

This module has the public names of the package. The module that defines a name is imported at the first use of the
name, so that a command can start PETSc with its own options first.
"""

from app.base import import_path

_user_modules = import_path.search_current_folder_last()
with import_path.names_shadows(_user_modules):
    from functools import partial
    from importlib import import_module

    from app.base import packages, petsc_path, user_folder, views  # noqa: F401  petsc_path finds petsc4py

user_folder.ensure_home()
packages.install()
views.load = partial(import_module, "app.api.views")

__version__ = "0.4.0"

_PLACES = {
    "Cone": "app.problems.shapes",
    "ContactProblem": "app.problems.contact_problem",
    "ContactSolver": "app.api.solver",
    "Cylinder": "app.problems.shapes",
    "EllipticHertz": "app.reference.hertz",
    "FlatPunch": "app.problems.shapes",
    "Grid": "app.halfspace.grid",
    "InputError": "app.base.errors",
    "Listener": "app.contact.history",
    "Material": "app.halfspace.material",
    "NoteWarning": "app.base.errors",
    "Paraboloid": "app.problems.shapes",
    "Plane": "app.problems.shapes",
    "Roller": "app.problems.roller",
    "SelfAffineSurface": "app.problems.random_surfaces",
    "Solution": "app.api.solution",
    "Sphere": "app.problems.shapes",
    "fit_grid": "app.api.fitted_grid",
    "read_result": "app.io.result",
    "read_surface": "app.problems.surfaces.reading",
    "refine": "app.api.refinement",
    "roughness": "app.problems.statistics",
    "solve": "app.api.solver",
    "solve_many": "app.api.many",
    "stress": "app.api.subsurface",
    "von_mises": "app.halfspace.stress.subsurface",
}
__all__ = [*_PLACES, "__version__"]


def __getattr__(name):
    if name not in _PLACES:
        raise AttributeError(f"module 'app' has no attribute {name!r}")
    try:
        with import_path.names_shadows(_user_modules):
            return getattr(import_module(_PLACES[name]), name)
    except ImportError as error:
        if (
            type(error).__module__ == "app.base.errors"
        ):  # a missing package: without the frames of this program
            raise error.with_traceback(None) from None
        raise


def __dir__():
    return __all__
