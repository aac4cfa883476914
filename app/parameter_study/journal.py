"""What is finished, on disk. Not collective."""

from __future__ import annotations

import fcntl
import json
from contextlib import suppress

from app.base.errors import InputError


class Journal:
    """Outcomes of finished runs in a file of JSON lines, so that an interrupted sweep can go on.

    Parameters
    ----------
    path : Path
    resume : bool
        Keep what is there already; else start anew: what is there goes when the first outcome comes.

    Attributes
    ----------
    outcomes : dict
        Key -> outcome.
    dropped : dict
        The same of what is not kept.

    Raises
    ------
    InputError
        If another process is writing it.
    """

    def __init__(self, path, resume=False):
        self._path = path
        try:
            self._file = path.open("a+", encoding="utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InputError(f"{path}: another process is writing it") from None
        self.outcomes, self.dropped = {}, {}
        self._file.seek(0)
        for line in self._file:
            try:
                entry = json.loads(line)
                self.outcomes[entry.pop("key")] = entry
            except (ValueError, LookupError, AttributeError, TypeError):
                continue  # cut off when the process was killed, or nothing of ours
        if not resume:
            self.outcomes, self.dropped = {}, self.outcomes
        self._file.write("\n")  # ends a line that was cut off
        self._begins = not resume

    def add(self, key, outcome):
        """Record an outcome; it is on its way to the disk when this returns. InputError if it cannot be written."""
        try:
            if self._begins:
                self._file.truncate(0)
                self._begins = False
            json.dump({"key": key, **outcome}, self._file, default=_plain)
            self._file.write("\n")
            self._file.flush()
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}") from None
        self.outcomes[key] = outcome

    def close(self):
        """Close the file and let others write it."""
        with suppress(OSError):  # of what `add` has complained of
            self._file.close()


def _plain(value):
    return value.tolist()  # numpy scalars and arrays
