"""Options of one solver in PETSc's database, under the solver's prefix.

PETSc's database has space for only 512 options, so it has the options of a solver only during set-up and solves.
Options that the user has set in the database under the same prefix stay there, and override the solver's options.
"""

import ctypes
import re
from contextlib import contextmanager

from petsc4py import PETSc

from app.base.errors import InputError
from app.base.mpi import MPI
from app.base.petsc import call, error_message

# PETSc reads these options while it solves, all others in set-up.
_READ_LATE = re.compile(r"(\w+_)?(ksp_converged_reason|mat_view|snes_(converged_reason|\w*view\w*|test_\w+))")
_PROBE = "app_solver_options_probe"  # a name that no option has


class SolverOptions:
    """Options of one solver.

    They are in PETSc's database only inside ``with`` blocks of `inserted`. The `prefix`, before all names in the
    database, begins with a letter or is empty. In `texts`, names have no dash and no prefix, and an option without
    value has the empty text. Options ``lcp_*`` are kept apart, because PETSc does not read them. The names in `ignored`
    are never reported as unused.

    Attributes
    ----------
    texts : dict of str to str
        The options for PETSc, without ``lcp_*``.
    used : set of str
        Names of the options that PETSc has read on this rank.

    Examples
    --------
    >>> options = SolverOptions("mine_", {"ksp_rtol": "0.1", "ksp_bogus": ""})
    >>> with options.inserted():
    ...     PETSc.Options("mine_").getReal("ksp_rtol")
    0.1
    >>> options.used, PETSc.Options().hasName("mine_ksp_rtol")
    ({'ksp_rtol'}, False)
    """

    _made = 0  # number of prefixes made by this process

    def __init__(self, prefix, texts, ignored=()):
        self.prefix, self.used, self._is_inserted = prefix, set(), False
        self._ours = {name: text for name, text in texts.items() if name.startswith("lcp_")}
        self.texts = {name: text for name, text in texts.items() if name not in self._ours}
        self._judged = self.texts.keys() - set(ignored)

    @classmethod
    def new_prefix(cls, comm):
        """Return an unused prefix, such as ``contact0_`` for the first solver.

        Collective over the mpi4py communicator `comm`. The prefix is unused on all of its ranks, even if they have made
        different numbers of solvers before.
        """
        number = comm.allreduce(cls._made, MPI.MAX)
        cls._made = number + 1
        return f"contact{number}_"

    @contextmanager
    def inserted(self):
        """Insert options into PETSc's database for a ``with`` block.

        After the block, `used` also contains the options that PETSc has read in the block.
        """
        if self._is_inserted:
            yield
            return
        database = PETSc.Options()
        set_by_user = _names(database)
        inserted = [name for name in self.texts if self.prefix + name not in set_by_user]
        try:
            self._is_inserted = True
            for name in inserted:
                database.setValue(self.prefix + name, self.texts[name] or None)
            yield
        finally:
            self.used.update(name for name in self._judged - self.used if is_used(self.prefix + name))
            for name in inserted:
                database.delValue(self.prefix + name)
            self._is_inserted = False

    def insert_for_good(self, others):
        """Insert the options and leave them in PETSc's database.

        So PETSc's logs list them. `others` are options that the program itself has read; they count as used.
        """
        used = self._ours | others
        for name, text in (self.texts | used).items():
            PETSc.Options().setValue(self.prefix + name, text or None)
        for name in self.used | used.keys():
            _mark_used(self.prefix + name)

    def drop(self, names):
        """Remove options by their names."""
        for name in names:
            del self.texts[name]
        self._judged.difference_update(names)

    def unused(self, comm, late=False):
        """Return the options that no rank has used.

        Collective over the mpi4py communicator `comm`. Options that PETSc reads during a solve, not in set-up, are
        included only if `late` is true.
        """
        unused = self._judged - self.used
        if not late:
            unused = {name for name in unused if not _READ_LATE.fullmatch(name)}
        return sorted(set.intersection(*comm.allgather(unused)))


@contextmanager
def temporary_options(prefix, defaults, forced):
    """Set options of PETSc's database, with a prefix, for a ``with`` block.

    The `defaults` are set only if the user has not set them. The `forced` ones are set in any case; the value None
    removes an option. An option of the user that is replaced counts as used, so that PETSc does not report it.
    """
    database = PETSc.Options()
    set_by_user = _names(database)
    defaults, forced = ({prefix + name: text for name, text in each.items()} for each in (defaults, forced))
    replaced = {name: database.getString(name, "") for name in forced if name in set_by_user}
    temporary = {name: text for name, text in defaults.items() if name not in set_by_user} | forced
    try:
        for name, text in temporary.items():
            if text is None:
                database.delValue(name)
            else:
                database.setValue(name, text)
        yield
    finally:
        for name in temporary:
            database.delValue(name)
        for name, text in replaced.items():
            database.setValue(name, text or None)
            _mark_used(name)


def read_option_file(path, flag="-options_file"):
    """Return a file's options as PETSc reads them; InputError if PETSc refuses it."""
    database = PETSc.Options().create()
    try:
        database.insertString(f'{flag} "{path}"')
        names = filter(database.hasName, database.getAll())  # which also lists words of quoted values
        texts = {name.lower(): database.getString(name, "") for name in names}
        database.insertString(f"-{_PROBE}")
        if not database.hasName(_PROBE):
            raise InputError(f"option file {path}: -prefix_push and -prefix_pop do not match")
    except PETSc.Error as error:
        message = error_message(error)
        raise InputError(message if str(path) in message else f"option file {path}: {message}") from None
    finally:
        database.destroy()
    return texts


def options_with_prefix(prefix):
    """Return the options in PETSc's database that begin with a prefix.

    The names in the returned dict are without the prefix. Reading the options does not mark them as used.
    """
    database, texts = PETSc.Options(), {}
    for name in database.getAll():  # cuts values at blanks
        if name.lower().startswith(prefix):
            was_used = is_used(name)
            text = texts[name.lower().removeprefix(prefix)] = database.getString(name, "")
            if not was_used:  # reading it must not count
                database.delValue(name)
                database.setValue(name, text or None)
    return texts


def _names(database):
    return {*map(str.lower, database.getAll())}


def _mark_used(name):
    """Mark an option as used, so that PETSc does not report it."""
    PETSc.Options().getString(name, "")


def is_used(name):
    """Return whether an option of PETSc's database was read."""
    if hasattr(PETSc.Options, "used"):  # since 3.24, in which a PetscBool has one byte
        return PETSc.Options().used(name)
    used = ctypes.c_int()
    call("PetscOptionsUsed", None, name.encode(), ctypes.byref(used))
    return bool(used.value)
