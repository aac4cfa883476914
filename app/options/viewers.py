"""Checks of viewers in PETSc's options.

A viewer is a text ``KIND:FILE:FORMAT`` that says where and how PETSc prints an object. PETSc itself checks a viewer
only when it prints something, and aborts the program at some mistakes.
"""

import os
import re
from pathlib import Path

from app.base.errors import InputError, shorten

_KINDS = "ascii", "binary", "draw", "hdf5", "matlab", "saws", "socket", "string", "vtk"
_VIEW = re.compile(r"(\w+_)?(ksp|pc|mat|snes)_(view\w*|converged_reason)")
# Options at which PETSc aborts unless they are shown as text; some may be drawn, too.
_DRAWABLE = re.compile(r"(\w+_)?ksp_monitor(_true_residual|_solution)?")
_TEXT_ONLY = re.compile(r"(\w+_)?ksp_monitor_(short|range|max|singular_value)|snes_converged_reason")
_VECTORS = re.compile(r"(\w+_)?(ksp_view_(solution|rhs|final_residual)|snes_view_solution)")
_TO_FILE = re.compile("(ascii|binary|hdf5|matlab|vtk|):([^:]+)")
_MIN_BYTES = 4096  # of a file of text
_AS_TEXT, _DRAWN = r"(ascii)?(:[^:]*(:default)?)?", r"draw(:[^:]*(:(default|draw_lg))?)?"


def check_viewers(texts):
    """Check all viewers among the options of a solver.

    `texts` maps names of options to their texts.
    """
    for name, text in texts.items():
        if any(pattern.fullmatch(name) for pattern in (_VIEW, _DRAWABLE, _TEXT_ONLY)):
            check_viewer(name, text)


def estimate_files(texts, cells):
    """Return the files of viewers and their smallest sizes [bytes], by path.

    `texts` are the options of a solver of so many `cells`.
    """
    sizes = {}
    for name, text in texts.items():
        if viewer := _TO_FILE.match(text):
            kind, file = viewer.groups()
            per_cell = 8 if kind in ("binary", "hdf5") else 2
            size = _MIN_BYTES + per_cell * cells * bool(_VECTORS.fullmatch(name))
            sizes[file] = max(size, sizes.get(file, 0))
    return sizes


def check_viewer(name, text):
    """Check the text of an option that takes a viewer ``KIND:FILE:FORMAT``."""
    kind, file, *_ = [*text.split(":"), ""]
    if kind not in ("", *_KINDS):
        raise InputError(
            f"-{name} {shorten(text)}: must be nothing, or ascii:FILE:FORMAT, with any of {', '.join(_KINDS)}"
        )
    if _DRAWABLE.fullmatch(name):
        if not re.fullmatch(f"{_AS_TEXT}|{_DRAWN}", text, re.IGNORECASE):
            raise InputError(f"-{name} {text}: must be empty, ascii:FILE or draw")
    elif _TEXT_ONLY.fullmatch(name) and not re.fullmatch(_AS_TEXT, text, re.IGNORECASE):
        raise InputError(f"-{name} {text}: must be empty or ascii:FILE")
    if kind not in ("draw", "socket"):
        check_output(name, text, file)


def check_output(name, text, file):
    """Check that PETSc can write an option's output file."""
    folder = Path(file).parent
    if not folder.is_dir():
        raise InputError(f"-{name} {text}: there is no folder {folder}")
    if file and Path(file).is_dir():
        raise InputError(f"-{name} {text}: {file} is a folder")
    if file and not os.access(file if Path(file).exists() else folder, os.W_OK):
        raise InputError(f"-{name} {text}: {file} cannot be written")
