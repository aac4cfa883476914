"""Atomic writing of files, and checks of their paths before any work.

A file is written under a temporary name in the target's folder and renamed when it is complete.
"""

import hashlib
import os
import secrets
import stat
import time
from contextlib import contextmanager, suppress
from pathlib import Path

from app.base import hdf5
from app.base.errors import InputError, call_collectively, check_type, format_message

SUFFIXES = (".h5", ".hdf5")  # of result files
_SAMPLES, _SAMPLE_BYTES = 64, 1 << 16  # of a large file, for its hash
_HDF5_BLOCK_BYTES = 1 << 20  # growth of a file in memory
_MAX_TEMPORARY_AGE = 86400  # s; older temporary files are left by killed runs


def check_output_path(path, inputs=(), what="result file", suffixes=SUFFIXES):
    """Return the absolute path of a file to write, of the target if `path` is a link.

    An existing file will be replaced. Raises InputError, with `what` as name of the file, unless the path ends in one
    of the `suffixes`, is a regular file or free, and can be written; or if it is one of the `inputs`, or another user's
    file in a sticky folder. Missing inputs are ignored.
    """
    check_type(what, path, str | os.PathLike, "a file name")
    name, path = str(path), Path(path)
    if name.endswith("/") or path.suffix.lower() not in suffixes:
        raise InputError(f"{what} {name}: the name must end in {' or '.join(suffixes)}")
    try:
        target = _follow_link(path)
        folder = target.parent
        if target.exists() and not target.is_file():
            raise InputError(f"{what} {path}: exists and is not a regular file")
        if not folder.is_dir():
            raise InputError(f"{what} {path}: folder {folder} does not exist")
        sticky = folder.stat().st_mode & stat.S_ISVTX  # only owners rename files there, as in /tmp
        if sticky and target.exists() and os.geteuid() not in (0, folder.stat().st_uid, target.stat().st_uid):
            raise InputError(f"{what} {path}: is another user's, and {folder} keeps it; choose another name")
    except OSError as error:
        raise InputError(f"{what} {path}: {error.strerror}") from None
    if path.suffix.lower() in SUFFIXES:
        hdf5.File  # noqa: B018  raises an error if h5py is missing
    for other in inputs:
        with suppress(OSError):
            if Path(other).samefile(target):
                raise InputError(f"{what} {path}: is the input {other}; choose another name")
    try:
        temporary = make_temporary_name(target)
        temporary.touch(exist_ok=False)
        temporary.unlink()
    except OSError as error:
        raise InputError(f"{what} {path}: cannot write in {folder} ({error.strerror})") from None
    return target


def check_shared_folder(comm, path):
    """Raise InputError unless all hosts see the same folder of `path`. Collective."""

    def create():
        file = make_temporary_name(_follow_link(Path(path)))
        file.touch(exist_ok=False)
        return file

    def check():
        if not temporary.exists():
            raise ValueError(f"result file {path}: {temporary.parent} is not the folder of rank 0; share it")

    temporary = call_collectively(comm, create, only_root=True)
    try:
        call_collectively(comm, check)
    finally:
        if comm.rank == 0:
            remove(temporary)


def hash_file(path):
    """Return the SHA-256 of a file in hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_samples(path):
    """Return size and hash of a file, or None.

    If the file is larger than 4 MiB, only evenly spaced samples of it are hashed.
    """
    path = Path(path)
    if not path.is_file():
        return None
    size, samples = path.stat().st_size, hashlib.sha256()
    with path.open("rb") as file:
        for number in range(_SAMPLES):
            file.seek(number * max(size - _SAMPLE_BYTES, 0) // (_SAMPLES - 1))
            samples.update(file.read(_SAMPLE_BYTES))
    return size, samples.hexdigest()


def _follow_link(path):
    """Return the absolute path of a file, or of a link's target."""
    with suppress(RuntimeError):  # Python before 3.13 raises it for circular links
        target = path.resolve() if path.is_symlink() else path.absolute()
        if not target.is_symlink():
            return target
    raise InputError(f"{path}: the symbolic link leads to itself")


@contextmanager
def atomic_file(path):
    """Yield a temporary path that replaces `path` if the block succeeds.

    If the block raises or the process is killed, `path` stays as it was.
    """
    target = _follow_link(Path(path))
    temporary = make_temporary_name(target)
    try:
        yield temporary
        publish(temporary, target)
    except BaseException:
        remove(temporary)
        raise


@contextmanager
def report_write_errors(name):
    """Turn an OSError of a ``with`` block into an InputError about the file `name`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or format_message(error)
        raise InputError(f"{name}: cannot be written: {reason}") from None


@contextmanager
def disk_reserved(path, size=None):
    """Reserve disk space for a file of `size` bytes; after the block the file is as before.

    By default, reserve a block more than the file has. Devices have no size, but may refuse to be written. Raises
    InputError.
    """
    path, existed = Path(path), os.path.lexists(path)
    if path.is_char_device():
        with report_write_errors(path), path.open("wb", buffering=0) as device:
            device.write(b"")
    if existed and not path.is_file():
        yield
        return
    try:
        with report_write_errors(path), path.open("ab") as file:
            before = file.tell()
            try:
                os.posix_fallocate(file.fileno(), 0, size or before + os.fstat(file.fileno()).st_blksize)
                yield
            finally:
                file.truncate(before)
    finally:
        if not existed:
            remove(path)


def write_text(path, text):
    """Write a text (UTF-8) atomically."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def atomic_hdf5(path):
    """Yield an HDF5 file in memory; after the block, write it atomically.

    HDF5 cannot close a file on a full disk. So the file is written by system calls, which report the error.
    """
    import h5py

    with atomic_file(path) as temporary:
        in_memory = {"driver": "core", "backing_store": False, "block_size": _HDF5_BLOCK_BYTES}
        with h5py.File(temporary, "w", **in_memory) as file:
            yield file
            file.flush()
            image = file.id.get_file_image()
        temporary.write_bytes(image)


def make_temporary_name(path):
    """Return a temporary name in a path's folder.

    Temporary files in this folder that are older than a day are removed; killed runs left them.
    """
    for outdated in path.parent.glob(".contact-*.tmp"):
        with suppress(OSError):  # another process may have removed it
            if time.time() - outdated.stat().st_mtime > _MAX_TEMPORARY_AGE:
                outdated.unlink()
    return path.with_name(f".contact-{secrets.token_hex(8)}.tmp")


def remove(path):
    """Remove a file; ignore errors."""
    with suppress(OSError):
        path.unlink()


def publish(temporary, path):
    """Flush a temporary file, then rename it to `path`."""
    _sync(temporary)
    temporary.replace(path)
    _sync(temporary.parent)


def _sync(path):
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
