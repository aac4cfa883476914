"""Modules of the user that have the name of a module of Python or of an installed package.

This file is imported before all others, and imports only what Python has loaded when it starts.
"""

import os
import sys
from importlib.machinery import PathFinder

# While Python looks for the module of ``python -m MODULE``, sys.argv is "-m" and the arguments after MODULE.
_IS_COMMAND = os.path.basename(sys.argv[0]).startswith("contact-") or (
    sys.argv[0] == "-m" and sys.orig_argv[-len(sys.argv) :][0].removeprefix("-m").startswith("app.")
)


def search_current_folder_last():
    """Return the folder with the user's modules; in commands, move it to the end of Python's path.

    This is the current folder, or the folder of the user's program; None if removed. ``python -m`` and ``PYTHONPATH=.``
    search the current folder first. Then a file such as ``signal.py`` beside the data would replace a module of Python.
    """
    if not _IS_COMMAND and sys.path and sys.path[0]:
        return sys.path[0]
    try:
        folder = os.getcwd()
    except OSError:
        return None
    if _IS_COMMAND and (found := [path for path in sys.path if path in ("", folder)]):
        sys.path[:] = [path for path in sys.path if path not in ("", folder)] + found[:1]
    return folder


class names_shadows:
    """Context manager whose imports fail with the name of the file in `folder` that is to blame, if there is one."""

    def __init__(self, folder):
        self.folder = folder

    def __enter__(self):
        """Enter the block."""

    def __exit__(self, kind, error, trace):
        """Raise ImportError if a file of the user has replaced a module; in commands, print it and exit."""
        if not isinstance(error, Exception) or not (file := _find_shadow(error, self.folder)):
            return
        message = f"{file}: has the name of a module that this program needs; rename the file"
        message = f"{message} ({kind.__name__}: {' '.join(str(error).split())})"
        if _IS_COMMAND:
            print(f"error: {message}", file=sys.stderr)
            sys.exit(2)
        raise ImportError(message) from error


def _find_shadow(error, folder):
    """Return the file in `folder` that replaces a module, and that an error names or comes from."""
    while error is not None and folder:
        module = getattr(error, "obj", None)  # of an AttributeError
        if isinstance(error, ImportError):
            module = sys.modules.get((error.name or "").partition(".")[0])
        files, trace = [getattr(module, "__file__", None)], error.__traceback__
        while trace:
            files.append(trace.tb_frame.f_code.co_filename)
            trace = trace.tb_next
        for file in files:
            if isinstance(file, str) and _replaces_module(os.path.join(folder, file), folder):
                return file
        error = error.__cause__ or error.__context__
    return None


def _replaces_module(file, user_folder):
    folder, name = os.path.split(file)
    if name == "__init__.py":
        folder, name = os.path.split(folder)
    name = name.partition(".")[0]
    main = getattr(sys.modules.get("__main__"), "__file__", None)
    others = [path for path in sys.path if os.path.join(user_folder, path) not in (folder, f"{folder}/")]
    return folder == user_folder and file != main and name != "app" and _is_known(name, others)


def _is_known(module, folders):
    return module in sys.stdlib_module_names or PathFinder.find_spec(module, folders) is not None
