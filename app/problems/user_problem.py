"""User-defined problems: Python classes or functions; docs/extending.md has examples.

A function takes arrays x and y of cell centres [mm] and returns the undeformed distance [mm], NaN where contact is
impossible. A class derives from `app.problems.problem.Problem` and is called with the grid and the material. If it has
options of its own, it lists them in `OPTIONS` and reads them in ``from_options``.
"""

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
from app.problems.problem import Problem, evaluate_shape

_LIBRARY_FILES = re.compile(
    rf"^<|/(site|dist)-packages/|^{re.escape(sysconfig.get_path('stdlib'))}/|^{re.escape(str(Path(__file__).parent))}/"
)


def load(name):
    """Import a user's function or class by its name.

    The name is ``package.module.Name`` or ``path/to/file.py:Name``.

    Every rank imports the module itself. Modules are also searched in the current folder.
    """
    path, in_file, attribute = name.rpartition(":")
    if not in_file:
        path, _, attribute = name.rpartition(".")
    if not path or not attribute:
        raise InputError(f"-problem_type {name}: must be module.Name or file.py:Name")
    module = _call(name, _import_file if in_file else _import_module, path)
    if not hasattr(module, attribute):
        raise InputError(f"-problem_type {name}: {path} has no {attribute}")
    factory = getattr(module, attribute)
    if not callable(factory) or (isinstance(factory, type) and not issubclass(factory, Problem)):
        raise InputError(
            f"-problem_type {name}: must be a function of x and y, or a class derived from {Problem.__module__}.Problem"
        )
    return factory


def create(name, grid, material, texts):
    """Create a user-defined problem by its name, see `load`.

    `texts` maps all options to their texts. Return the problem, and the `OptionReader` of its own options.
    """
    factory = load(name)
    options = OptionReader(getattr(factory, "OPTIONS", ()), texts)
    if isinstance(factory, type):
        if hasattr(factory, "from_options"):
            problem = _call(name, factory.from_options, grid, material, options)
        else:
            problem = _call(name, factory, grid, material)
        if not isinstance(problem, Problem):
            raise InputError(f"-problem_type {name}: from_options returns no {Problem.__module__}.Problem")
    else:
        problem = ContactProblem(grid, material, factory)
    if not problem.name or problem.name == ContactProblem.name:
        object.__setattr__(problem, "name", name)
    return problem, options


def validate(problem, name, rows):
    """Raise InputError if the undeformed distance is invalid in some rows."""
    _call(name, evaluate_shape, problem, problem.grid, rows)


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
    spec = importlib.util.spec_from_file_location(f"own_{Path(path).stem}", path)  # the file may be app.py
    if spec is None:
        raise ImportError("is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # for dataclasses
    spec.loader.exec_module(module)
    return module


def _call(name, function, *arguments):
    """Call a function of the user; turn its errors into InputError.

    The message contains the line of the user's code.
    """
    try:
        return function(*arguments)
    except InputError as error:
        raise InputError(f"-problem_type {name}: {error}") from None
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        if frames[-1].filename == __file__:
            raise InputError(f"-problem_type {name}: {format_message(error)}") from None
        users = [frame for frame in frames if not _LIBRARY_FILES.search(frame.filename)]
        where = f" ({users[-1].filename}, line {users[-1].lineno})" if users else ""
        raise InputError(f"-problem_type {name}: {format_error(error)}{where}") from error
