"""Problems of the user's own, by name: a class or a function in a Python module, without touching this program.

A function is that of `app.problems.contact_problem.ContactProblem`: it takes arrays x and y of cell centres
[mm] and returns the undeformed distance [mm], NaN where contact is impossible::

    def rounded_punch(x, y):
        return np.where(np.hypot(x, y) <= 4, np.maximum(np.hypot(x, y) - 3, 0) ** 2 / 20, np.nan)

A class derives from `app.problems.problem.Problem`. It is made from the grid and the material; one that has options of
its own lists them in `OPTIONS` and reads them in ``from_options``::

    class Cone(Problem):
        OPTIONS = (Option("cone_slope", positive, 0.1, "height over radius"),)
        ...
        @classmethod
        def from_options(cls, grid, material, options):
            return cls(grid, material, options["cone_slope"])
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
import sysconfig
import traceback
from pathlib import Path

from app.base.errors import InputError, format_error, format_message
from app.options.option_table import OptionReader
from app.problems.contact_problem import ContactProblem
from app.problems.problem import Problem, checked_shape

_HERE = Path(__file__).parent
_NOT_THE_USERS = re.compile(
    rf"^<|/(site|dist)-packages/|^{re.escape(sysconfig.get_path('stdlib'))}/|^{re.escape(str(_HERE))}/"
)


def find(name):
    """Return what a name stands for: ``package.module.Name`` or ``path/to/file.py:Name``, as PETSc finds its own.

    Not collective: every rank imports for itself. The current folder is looked into, too.

    Raises
    ------
    InputError
        If there is no such module or name, or importing it fails.
    """
    path, in_file, attribute = name.rpartition(":")
    if not in_file:
        path, _, attribute = name.rpartition(".")
    if not path or not attribute:
        raise InputError(f"-problem_type {name}: needed: module.Name or file.py:Name")
    module = _called(name, _import_file if in_file else _import_module, path)
    if not hasattr(module, attribute):
        raise InputError(f"-problem_type {name}: {path} has no {attribute}")
    found = getattr(module, attribute)
    if not callable(found) or (isinstance(found, type) and not issubclass(found, Problem)):
        raise InputError(
            f"-problem_type {name}: needed: a function of x and y, or a class derived from {Problem.__module__}.Problem"
        )
    return found


def make(name, grid, material, texts):
    """Make the problem of a name, see `find`.

    Not collective.

    Parameters
    ----------
    name : str
    grid : app.halfspace.grid.Grid
    material : app.halfspace.influence.Material
    texts : mapping of str to str
        All options, the problem's own among them.

    Returns
    -------
    problem : Problem
    options : app.options.option_table.OptionReader
        Of the problem's own options.

    Raises
    ------
    InputError
        If that fails.
    """
    kind = find(name)
    options = OptionReader(getattr(kind, "OPTIONS", ()), texts)
    if isinstance(kind, type):
        make_it = getattr(kind, "from_options", None)
        parts = (grid, material) if make_it is None else (grid, material, options)
        problem = _called(name, make_it or kind, *parts)
        if not isinstance(problem, Problem):
            raise InputError(f"-problem_type {name}: from_options returns no {Problem.__module__}.Problem")
    else:
        problem = ContactProblem(grid, material, kind)
    if not problem.name or problem.name == ContactProblem.name:
        object.__setattr__(problem, "name", name)
    return problem, options


def check(problem, name, rows):
    """Ask for some rows of the undeformed distance and refuse what is no such thing.

    Not collective.

    Raises
    ------
    InputError
    """
    _called(name, checked_shape, problem, problem.grid, rows)


def _import_module(path):
    folder = str(Path.cwd())
    added = sys.path[0] not in (folder, "")
    if added:
        sys.path.insert(0, folder)
    try:
        return importlib.import_module(path)
    finally:
        if added:
            sys.path.remove(folder)


def _import_file(path):
    if not Path(path).is_file():
        raise FileNotFoundError("no such file")
    spec = importlib.util.spec_from_file_location(f"own_{Path(path).stem}", path)  # app.py may be its name
    if spec is None:
        raise ImportError("is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _called(name, function, *parts):
    """Call code of the user's; tell in one line what goes wrong in it, and where."""
    try:
        return function(*parts)
    except InputError as error:
        raise InputError(f"-problem_type {name}: {error}") from None
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        if frames[-1].filename == __file__:  # found here, not there
            raise InputError(f"-problem_type {name}: {format_message(error)}") from None
        theirs = [frame for frame in frames if not _NOT_THE_USERS.search(frame.filename)]
        where = f" ({theirs[-1].filename}, line {theirs[-1].lineno})" if theirs else ""
        raise InputError(f"-problem_type {name}: {format_error(error)}{where}") from error
