"""The strategy and the solvers of a method as its options say."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from inspect import signature
from types import ModuleType

import numpy as np
from petsc4py import PETSc

from app.api.strategy import STRATEGIES
from app.base.errors import InputError, call_collectively, format_error, shorten
from app.base.numba_cache import check_compiler
from app.base.petsc import check_cells, error_message, unwrap_errors
from app.contact.history import Listener
from app.multigrid.hierarchy import Hierarchy
from app.options.method import make_settings
from app.options.option_table import check_viewer, to_texts
from app.options.solver_options import SolverOptions, options_with_prefix
from app.problems.problem import Problem

# PETSc checks the viewer only when there is something to view.
_VIEW = re.compile(
    r"(\w+_)?((ksp|pc|mat|snes|tao)_(view\w*|converged_reason)"
    r"|ksp_monitor(_(short|range|max|singular_value|true_residual|solution))?)"
)
_OF_SOLVERS = re.compile("(lcp|ksp|pc|mg|sub|tao|snes)_")


def check_type(name, given, kind, what):
    """Refuse an argument of another type. Not collective."""
    if not isinstance(given, kind):
        raise InputError(f"{name}: is {type(given).__name__}; needed: {what}")


def parse_method(problem, method, options, prefix, listeners):
    """Settings of a method for a problem, and the options for PETSc; see `ContactSolver`. Not collective.

    Returns
    -------
    app.options.method.Settings, SolverOptions

    Raises
    ------
    InputError
        If it cannot be had on this machine.
    """
    check_type("problem", problem, Problem, "a ContactProblem")
    check_type("method", method, str | Mapping | None, "the name of a method file, or a mapping")
    check_type("listeners", listeners, Sequence, "a sequence of app.Listener")
    for listener in listeners:
        check_type("listeners", listener, Listener, "objects of a class made from app.Listener")
    check_type("prefix", prefix, str, "a word")
    if not re.fullmatch(r"([A-Za-z]\w*)?", prefix):
        raise InputError(f"prefix {shorten(prefix)}: must begin with a letter and be a word")
    prefix = prefix.lower()  # PETSc compares names without regard to case
    grid, own, global_ones = problem.grid, to_texts(options or {}), options_with_prefix(prefix)
    if prefix:
        texts, left_alone = own | global_ones, ()
    else:  # the database may have options of other programs
        left_alone = {name for name in global_ones if _OF_SOLVERS.match(name)} - own.keys()
        texts = {name: global_ones[name] for name in sorted(left_alone)} | own
    check_compiler()
    check_cells(grid)
    if dashed := [name for name in texts if name.startswith("-")]:
        raise InputError(f"options: {', '.join(dashed)}: needed: names without the dash")
    chosen = make_settings(method, texts, bool(grid.periodic))
    for name in filter(_VIEW.fullmatch, chosen.texts):
        check_viewer(name, chosen.texts[name])
    _check_parts(chosen.texts)
    ours = {name: text for name, text in chosen.texts.items() if name.startswith("lcp_")}
    for_petsc = {name: text for name, text in chosen.texts.items() if name not in ours}
    return chosen, SolverOptions(prefix, for_petsc, left_alone, ours)


def _check_parts(texts):
    """Refuse classes of preconditioners that PETSc cannot make, or use; not those that do not load: it says so itself.

    Not collective.
    """
    for name, text in texts.items():
        module, _, word = text.rpartition(".")
        if not name.endswith("pc_python_type") or not module:
            continue
        try:
            part = getattr(import_module(module), word)
        except (ImportError, AttributeError):
            continue
        except Exception as error:
            raise InputError(f"-{name} {text}: {format_error(error)}") from None
        if not callable(part):
            if not isinstance(part, ModuleType):
                raise InputError(f"-{name} {text}: is {type(part).__name__}; needed: a class")
        elif isinstance(part, type):
            if not hasattr(part, "apply") and not hasattr(part, "__getattr__"):
                raise InputError(f"-{name} {text}: has no method apply(pc, x, y)")
            try:
                signature(part).bind()
            except ValueError:  # none to look at
                continue
            except TypeError as error:
                raise InputError(f"-{name} {text}: PETSc makes it without arguments: {error}") from None


def make_hierarchy(grid, compliance, comm, chosen, prefix):
    """Grids and operators for a method. Collective over the mpi4py communicator `comm`.

    Parameters
    ----------
    grid : Grid
    compliance : float
        Of the material [mm2/N].
    comm : mpi4py.MPI.Comm
    chosen : app.options.method.Settings
    prefix : str
        Of PETSc's options.

    Returns
    -------
    Hierarchy
    """
    return Hierarchy(
        grid, compliance, comm, chosen.coarsest, chosen.cells_per_rank,
        target_only=STRATEGIES[chosen.strategy].target_only,
        dtype=np.float32 if chosen.single else np.float64,
        margin=chosen.window,
        prefix=prefix,
    )  # fmt: skip


def make_strategy(hierarchy, chosen):
    """Make what solves, with the solver of the target grid; what PETSc refuses is the user's to know. Collective.

    Returns
    -------
    Strategy

    Raises
    ------
    InputError
        If the options ask for what cannot be had.
    """
    try:
        return call_collectively(hierarchy.comm, _strategy, hierarchy, chosen)
    except InputError as error:
        refusal = f"solver options: {error}"
    # Now, not while the error holds what the refused solver has made; PETSc keeps that, and communicators for it.
    hierarchy.collect_garbage()
    raise InputError(refusal)


def _strategy(hierarchy, chosen):
    """As `make_strategy`, with a ValueError on the ranks that meet it."""
    try:
        with unwrap_errors():
            return STRATEGIES[chosen.strategy](chosen, hierarchy)
    except PETSc.Error as error:
        raise ValueError(error_message(error)) from None
    except (ImportError, AttributeError) as error:
        raise ValueError(str(error)) from None
