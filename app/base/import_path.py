"""Modules of the user that have the name of a module of Python or of an installed package.

This file is imported before all others, and imports only what Python has loaded when it starts.
"""

import os
import sys
from importlib.machinery import PathFinder

_IS_COMMAND = os.path.basename(sys.argv[0]).startswith("contact-") or (
    sys.argv[0] == "-m" and any(word.removeprefix("-m").startswith("app.") for word in sys.orig_argv)
)


def search_current_folder_last():
    """In commands, move the current folder to the end of Python's path.

    ``python -m`` and ``PYTHONPATH=.`` search it first. Then a file such as ``signal.py`` beside the data would replace
    a module of Python.
    """
    global _folder
    try:
        _folder = os.getcwd()
    except OSError:  # removed
        return
    if _IS_COMMAND and (found := [path for path in sys.path if path in ("", _folder)]):
        sys.path[:] = [path for path in sys.path if path not in ("", _folder)] + found[:1]
    elif not _IS_COMMAND and sys.path and sys.path[0]:
        _folder = sys.path[0]  # of the user's program


_folder = None


class names_shadows:
    """Context manager whose imports fail with the name of the user's file that is to blame, if there is one."""

    def __enter__(self):
        """Enter the block."""

    def __exit__(self, kind, error, trace):
        """Raise ImportError if a file of the user has replaced a module; in commands, print it and exit."""
        if error is None or not issubclass(kind, Exception) or not (files := _shadows(trace)):
            return
        message = f"{', '.join(files)}: has the name of a module that this program needs; rename the file"
        if _IS_COMMAND:
            print(f"error: {message}", file=sys.stderr)
            sys.exit(2)
        raise ImportError(message) from error


def _shadows(trace):
    """Return the user's files that were imported, or are in a traceback, and replace a module."""
    files = {
        getattr(module, "__file__", None) for name, module in [*sys.modules.items()] if name != "__main__"
    }
    while trace:
        files.add(trace.tb_frame.f_code.co_filename)
        trace = trace.tb_next
    found = []
    for file in sorted(filter(None, files)) if _folder else ():
        folder, name = os.path.split(os.path.join(_folder, file))
        if name == "__init__.py":
            folder, name = os.path.split(folder)
        module, others = (
            name.partition(".")[0],
            [path for path in sys.path if os.path.join(_folder, path) not in (folder, f"{folder}/")],
        )
        main = getattr(sys.modules.get("__main__"), "__file__", None)
        if folder == _folder and file != main and _is_known(module, others):
            found.append(file)
    return found


def _is_known(module, folders):
    return module in sys.stdlib_module_names or PathFinder.find_spec(module, folders) is not None
