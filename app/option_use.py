"""Which options nobody reads; what is a mistake is refused.

PETSc marks options that are looked up, nearly all in set-up, so that then those without a mark are read by nobody. For
the few that are looked up while solving only, another one is set, a probe, to its default, false: one that the same
object looks up in set-up. A KSP of prefix ``fine_`` looks up ``fine_ksp_converged_reason`` when it solves, and
``fine_ksp_error_if_not_converged`` in set-up: if the probe is read, there is such a KSP, and so will the option be.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace

from app.errors import InputError
from app.halfspace.communication import Communicator
from app.halfspace.grid import Grid
from app.method import METHOD_OPTIONS, PART_OPTIONS, settings
from app.method_solver import database_of, make_hierarchy, make_strategy
from app.mpi import MPI
from app.options import unknown_options
from app.petsc import Resources, help_text

# What PETSc looks up only while solving, and its probe, for any type of the object; default: false. A matrix has the
# prefix of the KSP on a block of it.
_READ_LATE = {
    r"(|\w+_)ksp_converged_reason": "ksp_error_if_not_converged",
    r"((?:\w+_)?sub_)mat_view": "ksp_error_if_not_converged",
    r"()snes_(converged_reason|view(_pre|_solution)?|test_jacobian(_view)?)": "snes_error_if_not_converged",
    r"()tao_((ls_)?view|test_(gradient|hessian)(_view)?)": "tao_recycle_history",
}


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
    for _, texts in chosen.files_so_far:
        if left := (unread.intersection(chosen.of_files) & texts.keys()) - overridden:
            alone, _ = _tried(texts, periodic)
            overridden |= left - alone
    if mistakes := unread - overridden:
        files = {  # the first that has the name
            name: file
            for file, texts in reversed(chosen.files_so_far)
            for name in texts
            if name in chosen.of_files
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
    try:
        with help_text() as told, suppress(InputError):
            chosen = settings({"": texts}, None, periodic)
            parts.add(hierarchy := make_hierarchy(grid, 1.0, parts.comm, chosen))
            database = database_of(chosen)
            database.set("help")
            unread = read_by(database, lambda: parts.add(make_strategy(hierarchy, chosen)))
    finally:
        parts.free()
    names = set(re.findall(r"^ +-(\w+)", "".join(told), re.MULTILINE))
    of_any_level = {re.sub(r"_\d+_", "_", name) for name in names}
    return unread, names | of_any_level
