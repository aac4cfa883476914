"""Checkpoint of finished runs or steps on disk."""

import fcntl
import json
from contextlib import suppress

from app.base.errors import InputError
from app.io.files import report_write_errors


class Journal:
    """Outcomes of runs or steps in a locked file of JSON lines.

    `outcomes` maps keys to outcomes. If `resume` is true, `outcomes` begins with the outcomes in the file. Otherwise
    the outcomes in the file are in `discarded`, and the first call of `add` removes these outcomes from the file.
    Raises InputError if the file cannot be written or is locked.
    """

    def __init__(self, path, resume=False):
        self._path = path
        with report_write_errors(path):
            self._file = path.open("a+", encoding="utf-8", errors="replace")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InputError(f"{path}: another process is writing it") from None
        self.outcomes, self.discarded = {}, {}
        self._file.seek(0)
        for line in self._file:
            # Skip lines cut off by a kill, and what is no journal.
            with suppress(ValueError, LookupError, AttributeError, TypeError):
                entry = json.loads(line)
                self.outcomes[entry.pop("key")] = entry
        if not resume:
            self.outcomes, self.discarded = {}, self.outcomes
        self._file.write("\n")  # ends a line that was cut off
        self._truncate = not resume

    def add(self, key, outcome):
        """Write an outcome to disk; raise InputError on failure."""
        with report_write_errors(self._path):
            if self._truncate:
                self._file.truncate(0)
                self._truncate = False
            json.dump({"key": key, **outcome}, self._file, default=lambda value: value.tolist())  # of numpy
            self._file.write("\n")
            self._file.flush()
        self.outcomes[key] = outcome

    def close(self):
        """Close and unlock the file."""
        with suppress(OSError):  # `add` has reported it
            self._file.close()
