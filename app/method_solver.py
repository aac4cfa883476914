"""The strategy and the solvers of a method as its options say, and which of them nobody reads."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.compiled import check_compiler
from app.contact.history import Listener
from app.errors import InputError, agree
from app.halfspace.communication import Communicator
from app.halfspace.grid import Grid
from app.method import METHOD_OPTIONS, PART_OPTIONS, settings
from app.multigrid.hierarchy import Hierarchy
from app.options import as_texts, unknown_options
from app.petsc import (
    OptionDatabase,
    Resources,
    as_raised,
    check_cells,
    error_message,
    help_text,
)
from app.problems.problem import Problem
from app.strategy import STRATEGIES

# What PETSc looks up only while solving; and one with default false that the same object, of whatever type, looks
# up in set-up. A matrix has the prefix of the KSP on a block of it.
_READ_LATE = {
    r"(|\w+_)ksp_converged_reason": "ksp_error_if_not_converged",
    r"((?:\w+_)?sub_)mat_view": "ksp_error_if_not_converged",
    r"()snes_(converged_reason|view(_pre|_solution)?)": "snes_error_if_not_converged",
    r"()tao_(ls_)?view": "tao_recycle_history",
}
# PETSc looks at the viewer only when there is something to view.
_VIEW = re.compile(r"(\w+_)?(ksp|pc|mat|snes|tao)_view\w*")
_VIEWERS = "ascii", "binary", "draw", "hdf5", "matlab", "saws", "socket", "string", "vtk"


def check_kind(name, given, kind, what):
    """Refuse an argument of another type. Not collective."""
    if not isinstance(given, kind):
        raise InputError(f"{name}: is {type(given).__name__}; needed: {what}")


def choose(problem, method, options, prefix, listeners):
    """Settings of a method for a problem, if it can be had on this machine; see `ContactSolver`. Not collective.

    Raises
    ------
    InputError
    """
    check_kind("problem", problem, Problem, "a ContactProblem")
    check_kind("method", method, str | Mapping | None, "the name of a method file, or a mapping")
    check_kind("listeners", listeners, Sequence, "a sequence of app.Listener")
    for listener in listeners:
        check_kind("listeners", listener, Listener, "objects of a class made from app.Listener")
    grid, texts = problem.grid, as_texts(options or {}) | _global_options(prefix)
    check_compiler()
    check_cells(grid)
    if dashed := [name for name in texts if name.startswith("-")]:
        raise InputError(f"options: {', '.join(dashed)}: needed: names without the dash")
    chosen = settings(method, texts, bool(grid.periodic))
    _check_views(chosen.texts)
    return chosen


def _check_views(texts):
    """Refuse viewers that there are not, or for files that cannot be. Not collective."""
    for name in filter(_VIEW.fullmatch, texts):
        kind, _, rest = texts[name].partition(":")
        if kind not in ("", *_VIEWERS):
            raise InputError(
                f"-{name} {texts[name]}: allowed: nothing, or ascii:FILE:FORMAT, with any of {', '.join(_VIEWERS)}"
            )
        folder = Path(rest.partition(":")[0]).parent
        if kind not in ("draw", "socket") and not folder.is_dir():
            raise InputError(f"-{name} {texts[name]}: there is no folder {folder}")


def _global_options(prefix):
    """Options of PETSc's global database that begin with a prefix, without it."""
    if not prefix:
        return {}
    database = PETSc.Options()
    return {
        name.removeprefix(prefix): database.getString(name, "")
        for name in database.getAll()
        if name.startswith(prefix)
    }


def make_hierarchy(grid, compliance, comm, chosen):
    """Grids and operators for a method. Collective over the mpi4py communicator `comm`.

    Parameters
    ----------
    grid : Grid
    compliance : float
        Of the material [mm2/N].
    comm : mpi4py.MPI.Comm
    chosen : app.method.Settings

    Returns
    -------
    Hierarchy
    """
    return Hierarchy(
        grid, compliance, comm, chosen.coarsest, chosen.cells_per_rank,
        target_only=STRATEGIES[chosen.strategy].target_only,
        dtype=np.float32 if chosen.single else np.float64,
        margin=chosen.window,
    )  # fmt: skip


def database_of(chosen):
    """Option database of a method: what PETSc is to read. Not collective."""
    texts = {name: text for name, text in chosen.texts.items() if not name.startswith("lcp_")}
    return OptionDatabase(texts)


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
        return agree(hierarchy.comm, _strategy, hierarchy, chosen)
    except InputError as error:
        refusal = f"solver options: {error}"
    # Now, not while the error holds what the refused solver has made; PETSc keeps that, and communicators for it.
    hierarchy.free_forgotten()
    raise InputError(refusal)


def _strategy(hierarchy, chosen):
    """As `make_strategy`, with a ValueError on the ranks that meet it."""
    try:
        with as_raised():
            return STRATEGIES[chosen.strategy](chosen, hierarchy)
    except PETSc.Error as error:
        raise ValueError(error_message(error)) from None
    except (ImportError, AttributeError) as error:
        raise ValueError(str(error)) from None


def read_by(database, make):
    """Call `make` with the options of a database; return the names of those that nobody reads. Collective as `make`."""
    given = database.texts()
    late = {
        name: f"{match[1]}{probe}"
        for name in given
        for pattern, probe in _READ_LATE.items()
        if (match := re.fullmatch(pattern, name))
    }
    probes = set(late.values()) - given.keys()
    for probe in probes:
        database.set(probe, "false")
    with database.active():
        make()
    unused = set(database.unused())
    for probe in probes:
        database.drop(probe)
    return {name for name in unused - probes if late.get(name, name) in unused}


def refuse_unread(unread, chosen, periodic):
    """Refuse options that nobody reads, unless they are a file's and something later has overridden them.

    What a file says is right if somebody reads it in what the files up to it make of a small problem. Not collective.

    Parameters
    ----------
    unread : set of str
    chosen : app.method.Settings
    periodic : bool

    Returns
    -------
    app.method.Settings
        Without them.

    Raises
    ------
    InputError
        If one is a mistake.
    """
    overridden = set()
    for _, texts in chosen.stages:
        if left := (unread.intersection(chosen.of_files) & texts.keys()) - overridden:
            alone, _ = _tried(texts, periodic)
            overridden |= left - alone
    if mistakes := unread - overridden:
        files = {
            name: file for file, texts in reversed(chosen.stages) for name in texts if name in chosen.of_files
        }
        ours = {option.name for option in (*METHOD_OPTIONS, *PART_OPTIONS)}
        _, of_petsc = _tried(chosen.texts, periodic)
        raise InputError(unknown_options(mistakes, ours | of_petsc, files, "unknown or unused"))
    return replace(chosen, texts={name: text for name, text in chosen.texts.items() if name not in unread})


def _tried(texts, periodic):
    """Solver of a small grid of this rank.

    Returns
    -------
    unread : set of str
        Options that nobody reads; all of them if the solver cannot be had.
    looked_up : set of str
        Names that PETSc looks up, as its help tells.
    """
    grid = Grid.from_domain(16, 16, (0.0, 1.0, 0.0, 1.0), periodic)
    parts, unread = Resources(), set(texts)
    parts.comm = Communicator(MPI.COMM_SELF.Dup())
    with help_text() as told:
        try:
            chosen = settings({"": texts}, None, periodic)
            parts.add(hierarchy := make_hierarchy(grid, 1.0, parts.comm, chosen))
            database = database_of(chosen)
            database.set("help")
            unread = read_by(database, lambda: parts.add(make_strategy(hierarchy, chosen)))
        except InputError:
            pass
    parts.free()
    names = set(re.findall(r"^ +-(\w+)", "".join(told), re.MULTILINE))
    return unread, names | {
        re.sub(r"_\d+_", "_", name) for name in names
    }  # those of one level are for all, too
