"""Files that appear whole or not at all, and only where nothing is lost by it.

A file is written under a temporary name in the folder of its target and renamed at the very end.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
import time
from contextlib import contextmanager, suppress
from pathlib import Path

from app.base.errors import InputError, call_collectively

SUFFIXES = (".h5", ".hdf5")  # of result files
_PIECES, _PIECE = 64, 1 << 16  # of a file, and bytes of each, that tell it from another one
_BLOCK = 1 << 20  # bytes by which a file in memory grows
_DAY = 86400  # s; no file is under its temporary name for so long


def check_output_path(path, inputs=(), what="result file", suffixes=SUFFIXES):
    """Refuse a path to which no file can be written, before any work is done.

    Not collective (looks at the file system of the calling rank).

    Parameters
    ----------
    path : str or Path
        File to be; it may exist and is then replaced later.
    inputs : iterable of str or Path
        Files that are read and must not be replaced; those that do not exist do not matter.
    what : str
        What it is, for messages.
    suffixes : sequence of str
        That its name may end in.

    Returns
    -------
    Path
        Absolute; where a symbolic link leads, if it is one.

    Raises
    ------
    InputError
        If the suffix is unknown, the path is not a regular file, or one of the inputs, or of another user in a folder
        such as /tmp, or its folder is missing, read-only, or the name is too long for it.
    """
    try:
        given, path = str(path), Path(path)
    except TypeError:
        raise InputError(f"{what}: is {type(path).__name__}; needed: a file name") from None
    if given.endswith("/") or path.suffix.lower() not in suffixes:
        raise InputError(f"{what} {given}: the name must end in {' or '.join(suffixes)}")
    try:
        target = _target(path)
        if target.exists() and not target.is_file():
            raise InputError(f"{what} {path}: exists and is not a regular file")
        if not target.parent.is_dir():
            raise InputError(f"{what} {path}: folder {target.parent} does not exist")
        if target.exists() and _guarded(target):
            raise InputError(
                f"{what} {path}: is another user's, and {target.parent} keeps it; choose another name"
            )
    except OSError as error:
        raise InputError(f"{what} {path}: {error.strerror}") from None
    for other in inputs:
        if _same_file(target, other):
            raise InputError(f"{what} {path}: is the input {other}; choose another name")
    try:
        temporary = make_temporary_name(target)
        temporary.touch(exist_ok=False)
        temporary.unlink()
    except OSError as error:
        raise InputError(f"{what} {path}: cannot write in {target.parent} ({error.strerror})") from None
    return target


def check_shared_folder(comm, path):
    """Refuse a result file to be in a folder that ranks on other hosts do not have. Collective.

    Raises
    ------
    InputError
        On all ranks.
    """
    probe = call_collectively(comm, _touch, path, only_root=True)
    try:
        call_collectively(comm, _find, probe, path)
    finally:
        if comm.rank == 0:
            remove(probe)


def _touch(path):
    probe = make_temporary_name(_target(Path(path)))
    probe.touch(exist_ok=False)
    return probe


def _find(probe, path):
    if not probe.exists():
        raise ValueError(f"result file {path}: {probe.parent} is not the folder that rank 0 has; share it")


def hash_file(path):
    """SHA-256 of a file, in hexadecimal digits; read piece by piece. Not collective."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_samples(path):
    """Size and digest of a file, None if there is none: of large ones some pieces only. Not collective."""
    path = Path(path)
    if not path.is_file():
        return None
    size, pieces = path.stat().st_size, hashlib.sha256()
    with path.open("rb") as file:
        for number in range(_PIECES):
            file.seek(number * max(size - _PIECE, 0) // (_PIECES - 1))
            pieces.update(file.read(_PIECE))
    return size, pieces.hexdigest()


def _target(path):
    """Where a path leads: a symbolic link stays, and what it names is replaced."""
    with suppress(RuntimeError):  # Python before 3.13, of a circle
        target = path.resolve() if path.is_symlink() else path.absolute()
        if not target.is_symlink():
            return target
    raise InputError(f"{path}: the symbolic link leads to itself")


def _guarded(target):
    """Whether the folder of a file lets its owner alone take its place, as /tmp does, and that is not us."""
    folder = target.parent.stat()
    return folder.st_mode & stat.S_ISVTX and os.geteuid() not in (0, folder.st_uid, target.stat().st_uid)


def _same_file(one, other):
    try:
        return Path(other).samefile(one)
    except OSError:
        return False


@contextmanager
def atomic_file(path):
    """Yield a temporary path whose file takes the place of `path` when the block succeeds.

    Not collective. A block that raises, or a killed process, leaves an existing `path` as it was.
    """
    target = _target(Path(path))
    temporary = make_temporary_name(target)
    try:
        yield temporary
        publish(temporary, target)
    except BaseException:
        remove(temporary)
        raise


def write_text(path, text):
    """Write a text (UTF-8), whole or not at all. Not collective."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def atomic_hdf5(path):
    """Yield an HDF5 file in memory that is written to `path` when the block succeeds. Not collective.

    HDF5 cannot close a file that a full disk kept it from writing; plain system calls say what is wrong.
    """
    import h5py

    with atomic_file(path) as temporary:
        with h5py.File(temporary, "w", driver="core", backing_store=False, block_size=_BLOCK) as file:
            yield file
            file.flush()
            image = file.id.get_file_image()
        temporary.write_bytes(image)


def make_temporary_name(path):
    """Return an unused name in the folder of `path`, so that the later rename stays in one file system.

    Not collective. It is short, whatever the name of `path`. What killed runs left in the folder a day ago goes.
    """
    for left in path.parent.glob(".contact-*.tmp"):
        with suppress(OSError):  # Another process may have removed it.
            if time.time() - left.stat().st_mtime > _DAY:
                left.unlink()
    return path.with_name(f".contact-{secrets.token_hex(8)}.tmp")


def remove(path):
    """Remove a file that may never have come to be; one that stays is not worth a second error. Not collective."""
    try:
        path.unlink(missing_ok=True)
    except OSError:
        pass


def publish(temporary, path):
    """Bring the file to disk, then give it its name: a crash leaves the old file or the new one. Not collective."""
    _to_disk(temporary)
    temporary.replace(path)
    _to_disk(temporary.parent)


def _to_disk(path):
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
