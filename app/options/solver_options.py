"""Options of one solver, in PETSc's database under a prefix of its own.

PETSc's database holds 512 options, so those of a solver are in it during set-up and solves only. What the user has set
under the prefix stays there, and wins.
"""

from __future__ import annotations

import ctypes
import re
from contextlib import contextmanager
from itertools import count

from petsc4py import PETSc

from app.base.errors import InputError
from app.base.mpi import MPI
from app.base.petsc import call, error_message, unwrap_errors

# PETSc reads these while it solves, all others in set-up.
_READ_LATE = re.compile(
    r"(\w+_)?(ksp_converged_reason|mat_view|(snes|tao)_(converged_reason|\w*view\w*|test_\w+))"
)
_PROBE = "app_solver_options_probe"  # a name that no option has


class SolverOptions:
    """Options of one solver, which PETSc and petsc4py read inside of `inserted`.

    Not collective.

    Parameters
    ----------
    prefix : str
        Begins with a letter, or is empty.
    texts : mapping of str to str
        Names without dash and prefix, and values; the empty text for an option without one.
    left_alone : iterable of str
        Names that never count as unused.
    ours : mapping of str to str, optional
        Options that PETSc does not read.

    Attributes
    ----------
    used : set of str
        Names that this rank has looked up.

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

    def __init__(self, prefix, texts, left_alone=(), ours=None):
        self.prefix, self.texts, self.used, self._ours = prefix, dict(texts), set(), dict(ours or {})
        self._judged, self._inside = self.texts.keys() - set(left_alone), False

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
        """Keep the options in PETSc's database inside the block, and note which are used."""
        if self._inside:
            yield
            return
        database = PETSc.Options()
        given = names_given(database)
        ours = [name for name in self.texts if self.prefix + name not in given]
        try:
            self._inside = True
            for name in ours:
                database.setValue(self.prefix + name, self.texts[name] or None)
            with unwrap_errors():
                yield
        finally:
            self.used.update(name for name in self._judged - self.used if is_used(self.prefix + name))
            for name in ours:
                database.delValue(self.prefix + name)
            self._inside = False

    def leave(self, others=None):
        """Put all options into PETSc's database for good, for its views and logs.

        `others`: names and texts of more that count as used.
        """
        used = self._ours | (others or {})
        for name, text in (self.texts | used).items():
            PETSc.Options().setValue(self.prefix + name, text or None)
        for name in self.used | used.keys():
            mark_used(self.prefix + name)

    def drop(self, name):
        """Forget an option."""
        del self.texts[name]
        self._judged.discard(name)

    def unused(self, comm, late=False):
        """Names of the options that no rank has used, sorted.

        Collective over the mpi4py communicator `comm`.

        Parameters
        ----------
        late : bool
            Count those that PETSc reads while it solves, too.
        """
        unused = self._judged - self.used
        if not late:
            unused = {name for name in unused if not _READ_LATE.fullmatch(name)}
        return sorted(set.intersection(*comm.allgather(unused)))


@contextmanager
def temporary_options(prefix, defaults, forced):
    """Set options of PETSc's database inside the block. Not collective.

    Parameters
    ----------
    prefix : str
        Of all names.
    defaults, forced : mapping of str to str
        For where the user has given none; in any case, None: as if not given. What is replaced counts as used.
    """
    database = PETSc.Options()
    given = names_given(database)
    defaults, forced = ({prefix + name: text for name, text in each.items()} for each in (defaults, forced))
    before = {name: database.getString(name, "") for name in forced if name in given}
    temporary = {name: text for name, text in defaults.items() if name not in given} | forced
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
        for name, text in before.items():
            database.setValue(name, text or None)
            mark_used(name)


def read_option_file(path, flag="-options_file"):
    """Let PETSc read an option file that exists; return name -> text. Not collective.

    `flag`: the option of PETSc that reads it.

    Raises
    ------
    InputError
        If PETSc does not accept it.
    """
    database, prefix = PETSc.Options(), "app_option_file_"  # with which no other option begins
    try:
        database.insertString(f'-prefix_push {prefix} {flag} "{path}"')
    except PETSc.Error as error:
        message = error_message(error)
        raise InputError(message if str(path) in message else f"option file {path}: {message}") from None
    finally:
        pushed = _pop_prefixes(database)
        found = options_with_prefix(prefix)
        for name in found:
            database.delValue(prefix + name)
    if pushed != 1:
        raise InputError(f"option file {path}: -prefix_push and -prefix_pop do not match")
    return found


def _pop_prefixes(database):
    """Pop all prefixes that PETSc puts before new options; return how many there were."""
    for pushed in count():
        database.insertString(f"-{_PROBE}")
        [probe] = (name for name in database.getAll() if name.endswith(_PROBE))
        database.delValue(probe)
        if probe == _PROBE:
            return pushed
        database.insertString("-prefix_pop")


def options_with_prefix(prefix):
    """Options in PETSc's database that begin with a prefix: name without it -> text. Not collective."""
    database, found = PETSc.Options(), {}
    for name in database.getAll():  # which cuts values at blanks
        if name.lower().startswith(prefix):
            used = is_used(name)
            text = found[name.lower().removeprefix(prefix)] = database.getString(name, "")
            if not used:
                database.delValue(name)
                database.setValue(name, text or None)
    return found


def names_given(database):
    """Names in PETSc's database, in lower case. Not collective; does not count as using them."""
    return {*map(str.lower, database.getAll())}


def mark_used(name):
    """Let an option of PETSc's database count as used. Not collective."""
    PETSc.Options().getString(name, "")


def is_used(name):
    """Whether an option of PETSc's database was looked up; petsc4py 3.24 has ``Options.used``. Not collective."""
    used = ctypes.c_int()
    call("PetscOptionsUsed", None, name.encode(), ctypes.byref(used))
    return bool(used.value)
