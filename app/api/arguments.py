"""Checks of the arguments of `ContactSolver`."""

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from importlib import import_module
from inspect import signature
from types import ModuleType

import numpy as np

from app.base.errors import InputError, check_type, format_distinct, format_error, shorten
from app.base.numba_cache import check_compiler
from app.base.petsc import check_cells
from app.contact.history import Listener
from app.io.files import disk_reserved
from app.options.method import DEFAULT, make_settings
from app.options.option_table import to_texts
from app.options.solver_options import SolverOptions, options_with_prefix
from app.options.viewers import check_viewers, estimate_files
from app.problems.arrays import check_compliance
from app.problems.problem import Problem

MIN_LOVE_THICKNESS = 1e-3  # of a layer over the side of the patch; the sums over images are long below
INCOMPRESSIBLE_POISSON = 0.495  # ratio above which cells wider than a layer are refused
MAX_LAYER_CELL = 3.0  # largest cell of an incompressible layer, over its thickness
_OF_SOLVERS = re.compile("(lcp|ksp|pc|mg|sub|snes)_")


def check_parts(what, problem, *names):
    """Raise InputError if the problem has one of the named quantities."""
    for name in names:
        if np.any(getattr(problem, name)):
            raise InputError(f"{what}: not with a {name.replace('_', ' ')}")


def parse_arguments(problem, method, options, prefix, listeners):
    """Return `Settings` and `SolverOptions` from the arguments of `ContactSolver`.

    Raises InputError if an argument is not allowed, or if this machine cannot do what it asks for.
    """
    check_type("problem", problem, Problem, "a ContactProblem")
    if problem.material.own_kernel is not None:
        _check_own_kernel(problem)
    check_type("method", method, str | Mapping | None, "the name of a method file, or a mapping")
    check_type("listeners", listeners, Sequence, "a sequence of app.Listener")
    for listener in listeners:
        check_type("listeners", listener, Listener, "of a class made from app.Listener")
    check_type("prefix", prefix, str, "a word")
    if not re.fullmatch(r"([A-Za-z]\w*)?", prefix):
        raise InputError(f"prefix {shorten(prefix)}: must begin with a letter and be a word")
    prefix = prefix.lower()  # as PETSc compares names
    own, in_database = to_texts(options or {}), options_with_prefix(prefix)
    if prefix:
        texts, ignored = own | in_database, ()
    else:  # the database may have options of other programs
        ignored = {name for name in in_database if _OF_SOLVERS.match(name)} - own.keys()
        texts = {name: in_database[name] for name in sorted(ignored)} | own
    check_compiler()
    check_cells(problem.grid)
    for coating in problem.material.coatings:
        _check_layer(problem.grid, coating)
    if dashed := [name for name in texts if name.startswith("-")]:
        raise InputError(f"options: {', '.join(dashed)}: must be names without the dash")
    grid = problem.grid
    check_compliance(problem.surface_compliance, grid)
    varies = problem.compliance is not None
    kinds = grid.doubly_periodic and not varies, problem.kernel.is_thin_film(grid) and not varies
    settings = make_settings(method, texts, *kinds)
    if varies and settings.type != DEFAULT:
        what = f"-lcp_type {settings.type}: not with a surface compliance that varies"
        raise InputError(f"{what}; must be {DEFAULT}")
    check_viewers(settings.texts)
    _check_python_types(settings.texts)
    return settings, SolverOptions(prefix, settings.texts, ignored)


def check_disks(texts, cells=None):
    """Raise InputError unless the disks have space for the files of viewers.

    `texts` are the options of a solver of so many `cells`. Without `cells`, the files are written already: a disk that
    has no space for more may have lost the ends of texts, which PETSc does not report.
    """
    with ExitStack() as stack:
        for path, size in estimate_files(texts, cells or 0).items():
            stack.enter_context(disk_reserved(path, size if cells else None))


def _check_own_kernel(problem):
    """Raise InputError unless a user's kernel has positive compliances."""
    own, q = problem.material.own_kernel, 2 * np.pi / np.array(problem.grid.sides)
    compliance = np.asarray(own.wave_compliance(q, q))
    if compliance.shape != q.shape or compliance.dtype.kind not in "fiu":
        raise InputError(
            f"{own!r}: wave_compliance must return an array of real numbers, of the shape of qx and qy"
        )
    if not 0 < problem.kernel.smallest_eigenvalue(problem.grid) < np.inf:
        raise InputError(f"{own!r}: the compliance of some waves is not positive")


def _check_layer(grid, coating):
    """Raise InputError for a layer that does not suit the patch."""
    thickness, cell = coating.thickness, grid.widest_cell
    thinnest = MIN_LOVE_THICKNESS * max(grid.sides)
    if grid.symbol == "love" and thickness < thinnest:
        raise InputError(
            f"coating thickness {format_distinct(thickness, thinnest)} mm: must be at least "
            f"{format_distinct(thinnest, thickness)} mm with uniform pressures on the cells of this patch; or use "
            "periodic='spectral' (-periodic_symbol spectral)"
        )
    is_incompressible = coating.on_rigid_base and coating.poisson[0] > INCOMPRESSIBLE_POISSON
    widest = MAX_LAYER_CELL * thickness
    if grid.symbol != "spectral" and is_incompressible and cell > widest:
        raise InputError(
            f"cells of {format_distinct(cell, widest)} mm: an incompressible layer needs cells of at most 3 times its "
            f"thickness, {format_distinct(widest, cell)} mm"
        )


def _check_python_types(texts):
    """Raise InputError for preconditioner classes that would abort PETSc.

    `texts` are options; those whose names end in ``pc_python_type`` name the classes.
    """
    for name, text in texts.items():
        module, _, attribute = text.rpartition(".")
        if not name.endswith("pc_python_type") or not module:
            continue
        try:
            part = getattr(import_module(module), attribute)
        except (ImportError, AttributeError):
            continue
        except Exception as error:
            raise InputError(f"-{name} {text}: {format_error(error)}") from None
        if not callable(part) and not isinstance(part, ModuleType):
            raise InputError(f"-{name} {text}: is {type(part).__name__}; must be a class")
        if isinstance(part, type):
            if not hasattr(part, "apply") and not hasattr(part, "__getattr__"):
                raise InputError(f"-{name} {text}: has no method apply(pc, x, y)")
            try:
                signature(part).bind()
            except ValueError:  # a class without a signature
                continue
            except TypeError as error:
                raise InputError(f"-{name} {text}: PETSc makes it without arguments: {error}") from None
