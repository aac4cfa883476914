"""Options of one solver in PETSc's database, under its prefix.

PETSc's database holds 512 options. Those of a solver are in it during set-up and solves only. Options that the user has
set under the prefix stay there, and override the solver's.
"""

import ctypes
import re
from contextlib import contextmanager

from petsc4py import PETSc

from app.base.errors import InputError
from app.base.mpi import MPI
from app.base.petsc import call, error_message

# PETSc reads these options while it solves, all others in set-up.
_READ_LATE = re.compile(
    r"(\w+_)?(ksp_converged_reason|mat_view|(snes|tao)_(converged_reason|\w*view\w*|test_\w+))"
)
_PROBE = "app_solver_options_probe"  # name of no option


class SolverOptions:
    """Options of one solver, in PETSc's database inside of `inserted`.

    Parameters
    ----------
    prefix : str
        Begins with a letter, or is empty.
    texts : mapping of str to str
        Names without dash and prefix, and values; the empty text for an option without one. PETSc does not read
        ``lcp_*``.
    ignored : iterable of str
        Names that never count as unused.

    Attributes
    ----------
    texts : dict of str to str
        Options that PETSc reads.
    used : set of str
        Names that this rank has read.

    Examples
    --------
    >>> options = SolverOptions("mine_", {"ksp_rtol": "0.1", "ksp_bogus": ""})
    >>> with options.inserted():
    ...     PETSc.Options("mine_").getReal("ksp_rtol")
    0.1
    >>> options.used, PETSc.Options().hasName("mine_ksp_rtol")
    ({'ksp_rtol'}, False)
    """

    _made = 0  # prefixes

    def __init__(self, prefix, texts, ignored=()):
        self.prefix, self.used, self._is_inserted = prefix, set(), False
        self._ours = {name: text for name, text in texts.items() if name.startswith("lcp_")}
        self.texts = {name: text for name, text in texts.items() if name not in self._ours}
        self._judged = self.texts.keys() - set(ignored)

    @classmethod
    def new_prefix(cls, comm):
        """Make a prefix, ``contact0_`` for the first solver of a process.

        Collective over the mpi4py communicator `comm`, whose ranks may have made other numbers of solvers.
        """
        number = comm.allreduce(cls._made, MPI.MAX)
        cls._made = number + 1
        return f"contact{number}_"

    @contextmanager
    def inserted(self):
        """Insert the options into PETSc's database inside the block.

        Afterwards `used` has those that were read.
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
        """Insert all options, and used ones of others, for PETSc's logs."""
        used = self._ours | others
        for name, text in (self.texts | used).items():
            PETSc.Options().setValue(self.prefix + name, text or None)
        for name in self.used | used.keys():
            _mark_used(self.prefix + name)

    def drop(self, names):
        """Remove options."""
        for name in names:
            del self.texts[name]
        self._judged.difference_update(names)

    def unused(self, comm, late=False):
        """Return the names of options that no rank has used.

        Collective over the mpi4py communicator `comm`. Options that PETSc reads while it solves count if `late`.
        """
        unused = self._judged - self.used
        if not late:
            unused = {name for name in unused if not _READ_LATE.fullmatch(name)}
        return sorted(set.intersection(*comm.allgather(unused)))


@contextmanager
def temporary_options(prefix, defaults, forced):
    """Set options of PETSc's database inside the block.

    Parameters
    ----------
    prefix : str
        Of all names.
    defaults, forced : mapping of str to str
        Set unless the user has; set in any case, or removed if None. Replaced options count as used.
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
    """Return the options of a file, as PETSc reads them.

    Raises
    ------
    InputError
        If PETSc does not accept it.
    """
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
    """Return options of PETSc's database without their common prefix."""
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
    """Return the names in PETSc's database, in lower case."""
    return {*map(str.lower, database.getAll())}


def _mark_used(name):
    PETSc.Options().getString(name, "")


def is_used(name):
    """Return whether an option of PETSc's database was read."""
    used = ctypes.c_int()
    call("PetscOptionsUsed", None, name.encode(), ctypes.byref(used))
    return bool(used.value)
